"""What edges contribute to pixels and gradients: the boundary term.

A pixel is the integral of a piecewise smooth function f of the image position over a square, and
every discontinuity of f is a curve on which one discrete decision of the tree of rays flips.
Samples miss two things of it. Of the pixel, they miss the part of a sample's cell that lies behind
the curve; and of the derivative by a parameter, what the curve moves (Reynolds' transport theorem):

    d/dtheta of the integral of f
        =  integral of df/dtheta  +  integral over the curves of (f- - f+) v_n

where f- and f+ are the values on either side and v_n is the speed of the curve along its normal.
The first term, the interior, is what automatic differentiation of samples gives; the second, the
boundary, is what it misses.

The method, on the regular grid of samples with spacing h:

1. Label each sample with a hash of its tree's decisions (`labels.py`). Two neighbours, side by side
   or one below the other, whose labels differ have an edge in between.
2. Walk both trees at once for the heaviest node that decides differently (`paths.py`), tell the
   event there (`events.py`), and find the root of its level function phi along the segment
   (`locate.py`). Where the labels beside the root are not those of the samples, more edges are in
   the segment, and the search goes on in what is left of it (`search.py`).
3. Say the crossing is at a distance c from the first sample. The border between the samples' cells
   is midway. What lies between the border and the crossing counted for the wrong sample; moving it
   to the other one adds (c - middle) (f- - f+) h to the pixels. Beside silhouettes and the onset of
   total reflection, f changes like the square root of the distance. There the derivatives are taken
   of other samples, in place of the two. The same is done at a crease from which a surface runs off
   into the distance between two samples (`quadrature.py`).
4. Where a parameter moves, the crossing at c moves by -phi_theta / phi_c. The segment's line stands
   for a strip of width h, in which the edge is taken to be straight. The area behind the edge
   changes by h times that motion. Each pixel gets the part that belongs to the piece of the edge in
   it. phi_theta is the derivative along one chain of rays, in forward or in reverse mode
   (`motion.py`).
5. Horizontal segments see steep edges well, and vertical segments flat ones. Each of the two sums
   is right for the edges that it sees. They are joined with weights g_x^4 / (g_x^4 + g_y^4) and
   g_y^4 / (g_x^4 + g_y^4), where g is the gradient of phi in the image. The weights also keep each
   term bounded: g_x^3 / (g_x^4 + g_y^4) <= 1.14 / |g|.
6. A pixel with three labels or more around it is sampled anew, more finely (`refinement.py`;
   adaptive subdivision: Whitted 1980). Where there are few labels, edges meet, and the finer
   samples are searched with the same method. Where there are more, edges crowd. There the pixel is
   the mean of its samples, and in derivatives an edge between two of them is told from these two
   alone (`between.py`, `blocks.py`; for pixels that share samples, `lattice.py`).
7. What edges moved into a pixel and out of it is cut off at the range of the radiance that the
   pixel's samples saw (`bounds.py`).
8. Where edges crowd, a sample's derivative counts as far as its neighbours confirm it
   (`representation.py`). With one sample a pixel, a sample beside an edge that was not found does
   not count.

The cost follows the number of edges. Each costs a few chains of rays, and those parts of four trees
of rays that weigh enough to have an edge.

Where edges crowd, each costs far less, at an error of the order of the samples' distance.

The method leaves three things to the samples. The more samples a pixel has, the less they matter:

- edges of nodes that weigh less than `settings.LEAST_WEIGHT` / spp in the pixel;
- edges of an object, or of a gap, that lies between two samples of the same label;
- checkerboards where several cells lie between two samples. Their motion fades out as the cells get
  smaller. Were it to end at once, the last edge would lack the one that cancels it.

A derivative by a weight below `LEAST_WEIGHT` / spp has only such edges, in what it reflects or
refracts. It has four times the samples instead.

Sources:

- Reynolds' transport and edge sampling: T.-M. Li et al., "Differentiable Monte Carlo Ray Tracing
  through Edge Sampling" (2018).
- Discontinuities of programs: S. Bangaru et al., "Systematically Differentiating Parametric
  Discontinuities" (2021); Y. Yang et al., "A-delta: Autodiff for Discontinuous Programs" (2022).
- Edges snapped to segments between samples, the closest to this: Y. Belhe et al. (2025).
- Adaptive subdivision: T. Whitted, "An Improved Illumination Model for Shaded Display" (1980).
"""
