"""A frame of a trajectory as input and target.

    estimate   what physics says of it beforehand
    scales     the scale of everything that a network sees and says
    samples    graph, target and noise
    batches    batches of a training, made ahead of time for a GPU
    frames     the same as a torch data set, for networks of one's own
    seen       what ranges a training has seen
"""
