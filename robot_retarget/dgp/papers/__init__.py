"""The papers' problem on free points: instances, solvers, rigidity and discretization."""
