"""The constants of the boundary term, what they were chosen by, and what moves with them.

Some comments say what is lost and gained. The other numbers were found by trying the shipped
scenes; halving or doubling one of them changes errors and times by a few percent.
"""

# Edges of a node are left to the samples if the node's weight is below this, divided by the samples
# a pixel. A smaller number finds more edges in mirrors of mirrors, and each costs as much as a
# bright one.
LEAST_WEIGHT = 1 / 8
# The same for rays of the samples beside an edge, and the most that it comes to. It is smaller,
# since all of their light counts, and not a difference.
LEAST_WEIGHT_BESIDE, MOST_WEIGHT_BESIDE = 1 / 16, 1 / 32
# A highlight ends at the terminator. If it is below this part of its light there, that is no edge.
LEAST_HIGHLIGHT = 1e-3

# With more cells of a checkerboard than this between two samples, the cells' edges are left to the
# samples: there are too many to find.
CELLS = 4
# The motion of a cell's edge counts in full up to the first number of cells from one sample to the
# next, and fades out up to the second. Were it to end at once, the last edge would lack the one
# that cancels it. It also counts in full nearer to the eye than half the third number, in cells;
# from that distance on it may fade. Cells crowd only far away.
FADING = 1, CELLS, 16
# The same between finer samples, where only one edge is looked for.
FADING_BETWEEN = 1 / 4, 1, 8

# How often the rest of a segment is searched for more edges: where crowds are searched as well, and
# where they are not. Glass mirrors all that is around it, so segments beside its outline often
# cross dozens of edges. Such segments lie in crowds.
ROUNDS, ROUNDS_WITHOUT_CROWDS = 24, 3
# Steps to the root of a level function, at most. Nearly all take 3 to 6.
ROOT_STEPS = 20
# A root is found after a step below this part of the bracket that the search began with. Steps
# shrink ever faster, so that what is left of the error is far smaller.
ROOT_TOLERANCE = {"single": 2.0**-9, "double": 2.0**-23}
# How far from an edge its two sides are looked at: a part of the distance between samples, but at
# least so many roundings of a number as large as the image. Farther may lie across the next edge;
# nearer is lost in rounding.
GAP, GAP_ULPS = {"single": 2.0**-10, "double": 1e-6}, 8
# The least tilt of an edge against its segment. It keeps 0 / 0 out of the edge's area.
LEAST_TILT = 1e-6
# The edge is at one end of a segment if its level there is below this part of the level at the
# other end. Rounding decides the sign of so small a level.
ON_SAMPLE = 2.0**-12
# A surface runs off into the distance between two samples if a ray meets it at a cosine below this,
# in units of the angle from one sample to the next.
GRAZING = 1 / 4
# Two surfaces touch, and their crease is one of rounding that does not move, if the sine of the
# angle between them is below this. Where a ball rests on a floor, that sine is about the root of
# rounding, and the crease would move thousands of times as fast as others.
TOUCHING = {"single": 2.0**-8, "double": 2.0**-22}

# A pair of samples gets extra samples beside an edge according to its share of that edge: none if
# the share is below SLIGHT, all if it is above 1 - SLIGHT, and a part in between. Without the
# limits, parts of samples close to an edge would spoil the sum.
SLIGHT = 0.3
# Where several edges lie between two samples, the line beside each is cut into this many pieces, at
# most.
PIECES = 4
# A pixel is cut off if it is outside of what its samples saw by this part of that range. Less is
# rounding.
LEAST_CUT = 1e-4
# Edges meet in a pixel, and do not crowd, with up to so many labels around it: with one sample a
# pixel, where none meet, and with several.
MEETING = 2, 4
# Who asks for many samples wants small errors. With the first number of samples along a pixel's
# side, derivatives have crowds searched as well; with the second, images too.
SEARCHED_SIDE, ALL_SEARCHED_SIDE = 4, 5
# Among more spheres in a tree than the first number, some of which mirror or refract, or more balls
# that mirror than the second, all pixels with edges are crowds. They get twice the samples along a
# side that other pixels have, and are never searched: that takes minutes, and among mirrors the
# derivatives of single samples are too large by far. Among 60 of them derivatives of a search err
# by 1.2 to 2.2, those of crowds by 0.5 to 0.3, in a sixth of the time; among 8, by 0.2 to 8 and by
# 0.2 to 0.8. Images err by 1.6 to 3 times as much as those of a search. Among 300 balls of glass a
# search errs by 0.5 and 0.4 at 1 and 4 samples, crowds by 0.6 and 0.5, in a quarter of the time.
MOST_SEARCHED, MOST_MIRRORS = 256, 5
# In pixels where edges crowd, the edge between two samples is left out if their radiance
# differs by less than this part of the greatest radiance in the pixel.
LEAST_CONTRAST = 1 / 32
# A pixel where edges crowd is busy if the contrasts of its pairs add up to more than this, times
# the samples along its side.
BUSY = 1
# Samples along the side of a pixel where edges crowd, at least, in derivatives.
COARSE_SIDE = 4
# The part of the cell of a sample inside a silhouette that moves with the silhouette.
ROOTED_PART = 0.3
# How much radiance may change from a sample to a neighbour behind an edge, as a part of its own.
MOST_CHANGE = 1 / 4

# Pairs of samples and finer samples that are searched at once, about. More take more memory, and
# keep Ctrl-C waiting.
SEARCHED = 1 << 18
# Lanes of one call of a kernel for samples, at most.
SAMPLES = 1 << 20
# The same for edges and derivatives, which keep much more for each lane.
LANES = 1 << 17
# Neighbouring packets of edges do like work. They are dealt out over this many parts of a kernel
# call, so that threads get equal shares.
SHARES = 16
