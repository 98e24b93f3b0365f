"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written symbolically."""
