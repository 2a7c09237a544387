"""Scenes of Mitsuba 3: what is what, as functions from dictionaries to dictionaries.

`read` makes the dictionary of a scene file from one that `mitsuba.load_dict` takes, `write` the
other way round. Neither needs Mitsuba; only XML files do, which Mitsuba itself reads.

| Mitsuba | here |
|---|---|
| `perspective`, `fov` along any `fov_axis`, or `focal_length` | `fov`, vertical |
| its `to_world`, a rotation and a translation | `position`, `look_at` (at `focus_distance`), `up` |
| `hdrfilm` with a `box` filter | `resolution` |
| `path` and its kin, `max_depth` N | `max_depth` N - 1; N where all light is the sky |
| `direct` | `max_depth` 1 |
| `sphere`, with rotation, translation and one scale | sphere |
| `disk` | disc |
| `rectangle`, if all rectangles close a room with all else in it | plane |
| `point`, radiant intensity I | inverse-square light of intensity I / pi |
| `directional`, irradiance E | directional light of irradiance E / pi |
| `constant`, where nothing is matte | `background` |
| `diffuse` | `color` |
| `checkerboard`, of square cells along the world's axes | `checker` |
| `conductor` without a metal, grey | `reflection` |
| `dielectric` on spheres, grey | `reflection`, `refraction`, `fresnel`, `ior` |
| `twosided` | both sides of a surface are alike anyway |

What differs and cannot be exact is a problem; with `approximate` it is a warning:

| | what is done |
|---|---|
| `rectangle` elsewhere | its infinite plane; a large rectangle on the way back |
| `constant` beside matte surfaces | it is seen, and lights nothing |
| `roughdielectric`, `roughconductor` | a smooth surface |
| coloured weights of glass and mirrors | their mean |
| `max_depth` -1 beside glass or mirrors | a depth of 10 |
| highlights, ambient light, `min_importance`, partial shadows | left out |
| reflection beside a color | the fainter of the two is left out |
| reflection of an opaque `fresnel` material | left out |
| constant weights of glass | those of Fresnel |
| lights without falloff | one that falls off, equally bright at `look_at` |

What only makes the pictures differ is taken, always with a warning:

| | here |
|---|---|
| another filter than `box`; the default is `gaussian` | a pixel is the mean of its square |
| light from one matte surface to another | it is not followed |
| the back of a one-sided surface, where it can be seen | it looks like the front |
| clipping planes that cut a shape | nothing is cut off |
| the eye or a light inside glass | radiance is not scaled there |

All else is a problem: other plugins, unknown parameters, shear, mirroring.
"""
