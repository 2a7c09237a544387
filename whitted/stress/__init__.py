"""Cases that are hard for ray tracers, with known answers."""
