"""Derivatives of radiance along rays, in forward and in reverse mode. What moves with an edge is
not in them.
"""
