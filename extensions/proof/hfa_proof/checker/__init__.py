"""The checker of certificates: it shares nothing with what proves."""
