"""Fast evaluation of CasADi Functions: bound memory, machine code, one copy for each thread."""
