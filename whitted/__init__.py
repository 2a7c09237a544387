"""A differentiable Whitted ray tracer on Dr.Jit's LLVM backend."""
