"""Beams pressed by an obstacle: beam theory, and a network for what it leaves over; all poses of a path at once.

    theory       a clamped beam under one force or torque
    beam         a scene seen from the beam's own frame, its sections as a few numbers
    touch        how an obstacle meets a beam
    features     the network's inputs, and what its output is added to
    samples      trajectories as tables of poses and sections
    model        a trained network with its scales, on disk and applied to poses
    path         all frames of a scene: a few poses, splines in time, nodes
    many         some frames of many paths of one beam
    calibration  how far off a frame may be
"""
