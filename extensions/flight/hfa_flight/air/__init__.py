"""Moving air: gusts and turbulence."""
