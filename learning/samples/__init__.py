"""A frame of a trajectory as input and target.

    estimate   what physics says of it beforehand
    samples    graph, target, noise, and the scale of everything
    seen       what ranges a training has seen
"""
