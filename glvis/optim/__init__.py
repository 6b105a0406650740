"""The optimisation, Sec. 2.2 of the paper: objectives, search methods, workers, checkpoints."""
