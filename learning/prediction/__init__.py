"""A whole path from a predictor.

    checkpoint   a trained network on disk
    memory       freed memory kept for the next step
    predictor    what all predictors have in common
    rollout      a network led through a trajectory by its own predictions
    rivals       trivial predictors, and finite elements on several meshes
    surrogates   trained networks, alone and corrected by Newton steps
    sweep        many obstacle paths for one body at once
    gradient     how the end of a path depends on the path
    foreign      what users bring along: folders of files, functions
"""
