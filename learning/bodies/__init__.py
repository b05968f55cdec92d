"""Bodies of any shape pressed by an obstacle: the shapes that they take, found in training, and a network for how much of each.

    body       a body and its obstacle as numbers, and what the network is shown of a pose
    shapes     smooth displacements of any body, and the few that bodies of a training take
    samples    trajectories as tables of poses
    model      a trained network with its scales and shapes, on disk and applied to poses
    path       frames of a scene, or of many
    at_once    one interface to the predictors of all frames at once, this one and that of beams
"""
