"""Which samples an image has, and the kernels that trace and differentiate them."""
