"""Recover a scene from its pictures."""
