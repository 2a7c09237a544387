"""Derivatives of radiance along rays, in forward and in reverse mode, without moving edges."""
