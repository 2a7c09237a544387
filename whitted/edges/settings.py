"""The constants of the boundary term, what they were chosen by, and what moves with them.

Where a comment names no trade, the number was found by trying the shipped scenes, and halving or
doubling it changes errors and times by a few percent.
"""

# Edges of nodes whose product of weights is below this, over the samples a pixel, are left to the
# samples. Smaller finds more edges in mirrors of mirrors, each of which costs as much as a bright
# one.
LEAST_WEIGHT = 1 / 8
# The same for the rays of a sample beside an edge. It is smaller, since there all light counts and
# not a difference.
LEAST_WEIGHT_BESIDE = 1 / 32
# A highlight below this part of its light has no edge where it ends.
LEAST_HIGHLIGHT = 1e-3

# Cells of a checkerboard between two samples beyond which their edges are left to the samples:
# there are too many to find.
CELLS = 4
# The motion of a cell's edge counts in full up to this many cells from one sample to the next, and
# not at all from CELLS on. Were it to end at once, the last edge would lack the one that cancels
# it.
FULL_MOTION_CELLS = 1
# All of it counts closer to the eye than half this many cells: edges are many only far away.
FAR_CELLS = 16

# Searches for edges in what is left of a segment, with several samples a pixel and with one. Beside
# the outline of glass, which mirrors all that is around it, segments of dozens of edges are common;
# with one sample they are not worth it.
ROUNDS, ROUNDS_OF_SINGLE_SAMPLES = 24, 2
# Most steps to the root of a level function. Nearly all take 3 to 6.
ROOT_STEPS = 20
# A root is found when a step is below this part of what is searched: finer than the gap to the
# edge's sides.
ROOT_TOLERANCE = {"single": 2.0**-9, "double": 2.0**-23}
# How far beside an edge its two sides are looked at, in units of the distance of samples, and at
# least in units of the spacing of numbers as large as the image. Farther is across the next edge;
# nearer is lost in rounding.
GAP, GAP_ULPS = {"single": 2.0**-10, "double": 1e-6}, 8
# The least tilt of an edge against its segment, which keeps 0 / 0 out of its area.
LEAST_TILT = 1e-6
# A level at one end of a segment, relative to the one at the other end, below which the edge is at
# that end: rounding decides on the sign of such a level.
ON_SAMPLE = 2.0**-12
# A cosine at which a surface is met, in units of the angle from one sample to the next, below which
# the surface runs off into the distance between the two.
GRAZING = 1 / 4

# Share of an edge below which a pair of samples gets no extra samples beside the edge; above 1 -
# SLIGHT it gets all, and in between a part. Without the limits, parts of samples close to an edge
# would spoil the sum.
SLIGHT = 0.3
# Into how many pieces what lies beside one of several edges between two samples is cut, at most.
PIECES = 4
# With one sample a pixel, those pixels where five labels meet are sampled 4 x 4 times only if they
# are more than one in so many of those where edges meet; else 2 x 2 times, with the others. A group
# of its own costs a kernel call.
FEW = 8

# Lanes of one call of a kernel, at most: samples; and edges and derivatives, which keep much more
# for each lane.
SAMPLES = 1 << 20
LANES = 1 << 17
# Neighbouring packets of edges do like work. They are dealt out to so many places of the kernel
# call, so that threads get equal shares.
SHARES = 16
