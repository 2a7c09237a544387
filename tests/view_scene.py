"""The scene of the tests of pages: a ball before a mirror, on a floor, under a lamp and a sun."""

TEXT = """# Kept by save
ambient = [0.1, 0.1, 0.1]
max_depth = 3

[camera]
position = [0, 0, 4]   # before the mirror
look_at = [0, 0, 0]
fov = 45
resolution = [48, 32]

[materials.red]
color = [0.8, 0.1, 0.1]

[materials.grey]
color = [0.5, 0.5, 0.5]

[materials.mirror]
reflection = 0.9

[[spheres]]
name = "ball"
center = [0.6, 0, 0.5]
radius = 0.4
material = "red"

[[discs]]
name = "mirror"
center = [-0.6, 0, -0.5]
normal = [0.35, 0, 1]
radius = 0.6
material = "mirror"

[[planes]]
name = "floor"
normal = [0, 1, 0]
offset = 1
material = "grey"

[[lights]]
name = "lamp"
position = [0, 1, 1]
intensity = [1, 1, 1]

[[lights]]
name = "sun"
type = "directional"
direction = [-1, -1, -1]
irradiance = [0.3, 0.3, 0.3]
"""
