"""CasADi Functions made fast: memory bound once, machine code, one copy a thread."""
