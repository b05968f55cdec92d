"""How is a mesh cut, and how good is the cut?

    edges       the graph of a mesh
    harmonics   Laplacian modes in numpy
    features    what nodes are compared by
    cut         METIS and modal superpixels
    clusters    as many nodes in each, by place alone
    quality     how good a cut is, and how many segments are best
    file        segments written into a trajectory
"""
