"""A frame of a trajectory as input and target.

    estimate   what physics says of it beforehand
    samples    graph, target, noise, and the scale of everything
    frames     the same as a torch data set, for networks of one's own
    seen       what ranges a training has seen
"""
