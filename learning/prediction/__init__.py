"""A whole path from a predictor.

    checkpoint   a trained network on disk
    memory       freed memory kept for the next step
    predictor    what all predictors have in common
    rollout      a network walking through a trajectory
    rivals       what knows nothing, and finite elements at several meshes
    surrogates   trained networks, alone and corrected by Newton steps
    foreign      what users bring along: folders of files, functions
"""
