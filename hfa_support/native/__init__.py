"""Fast evaluation of CasADi Functions: fixed memory, machine code, and one copy for each thread."""
