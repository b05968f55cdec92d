"""What does a network see of a frame?

    wants      what a network asks of a graph
    encoding   random walks as the place of a node or segment in its graph
    contact    pairs of nodes that are near each other
    levels     coarser graphs above a mesh
    graph      nodes, mesh edges, contact edges, segments, and their features
"""
