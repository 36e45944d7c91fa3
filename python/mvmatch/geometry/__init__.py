"""Two-view geometry and trajectories: arrays in, arrays out, deterministic for a given seed."""
