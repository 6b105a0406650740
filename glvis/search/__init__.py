"""The search for poses (Sec. 2.2): swarm, local search, surrogate, checkpoints."""
