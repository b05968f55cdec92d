"""A frame of a trajectory as input and target.

    estimate   the reduced-order estimate of a frame
    scales     the scale of everything that a network sees and predicts
    samples    graph, target and noise
    batches    batches of a training, made ahead of time for a GPU
    frames     the same as a torch data set, for networks of one's own
    seen       the ranges that a training has seen
"""
