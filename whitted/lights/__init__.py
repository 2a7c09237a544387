"""Lights. Each type is one file, and one entry here."""

from .directional import DirectionalLight
from .light import Light
from .point import PointLight

# By the `type` of a light's table in a file; the first is that of tables without one
LIGHTS: dict[str, type[Light]] = {"point": PointLight, "directional": DirectionalLight}

__all__ = ["LIGHTS", "DirectionalLight", "Light", "PointLight"]
