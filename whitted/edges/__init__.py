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
3. The part of the segment's line that lies behind the crossing goes from one sample to the other:
   (c - middle) (f- - f+) h. Other samples are differentiated in place of the two where f changes
   like the square root of the distance: beside silhouettes and the onset of total reflection. So
   they are at a crease from which a surface runs off into the distance between two samples
   (`quadrature.py`).
4. Where a parameter moves, the crossing at c moves by -phi_theta / phi_c. The segment's line stands
   for a strip of width h, in which the edge is taken to be straight. Its area changes by h times
   that, of which each pixel gets the part of the edge that lies in it. phi_theta is the derivative
   along one chain of rays, in forward or in reverse mode (`motion.py`).
5. Horizontal segments see an edge well that is steep, vertical ones one that is flat. Both sums are
   correct for edges that they see, and are joined with weights g_x^4 / (g_x^4 + g_y^4) and g_y^4 /
   (g_x^4 + g_y^4), g the gradient of phi in the image. The weights also keep each term bounded:
   g_x^3 / (g_x^4 + g_y^4) <= 1.14 / |g|.
6. A pixel with three labels or more around it has edges that meet or crowd. It is sampled anew,
   more finely, with the same method (`refinement.py`; adaptive subdivision: Whitted 1980).

The cost follows the number of edges: for each some chains of rays, and of four trees what weighs
enough to have an edge.

What the method leaves to the samples, less of it the more samples a pixel has: edges of nodes that
weigh less than `settings.LEAST_WEIGHT` / spp in the pixel; edges of an object or a gap that lies
between two samples of the same label; checkerboards where several cells lie between two samples.
What moves with those fades out as cells get smaller: were it to end at once, the last edge would
lack the one that cancels it. Derivatives by a weight below `LEAST_WEIGHT` / spp, for which edges in
what it reflects or refracts are such, have four times the samples instead.

Sources: Reynolds transport and edge sampling, T.-M. Li et al., "Differentiable Monte Carlo Ray
Tracing through Edge Sampling" (2018); discontinuities of programs, S. Bangaru et al.,
"Systematically Differentiating Parametric Discontinuities" (2021), Y. Yang et al., "A-delta:
Autodiff for Discontinuous Programs" (2022); edges snapped to segments between samples, the closest
to this, Y. Belhe et al. (2025); adaptive subdivision, T. Whitted, "An Improved Illumination Model
for Shaded Display" (1980).
"""
