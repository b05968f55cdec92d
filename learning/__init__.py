"""Learned simulators: graphs, segments, M4GN, training, rollouts, and their fidelity report."""
