"""What does a network see of a frame?

    encoding   random walks as the place of a node or segment in its graph
    graph      nodes, mesh edges, contact edges, segments, and their features
"""
