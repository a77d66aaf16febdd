"""Plain numba functions over arrays, and the choice of the engine that runs them."""
