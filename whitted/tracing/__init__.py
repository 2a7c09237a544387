"""The report's algorithm: closest hit, each light, reflect and refract."""
