"""The default scheme: rigid bodies by velocity Verlet, a static lattice under D'Alembert loads, events located by rollback."""
