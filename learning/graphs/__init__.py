"""What does a network see of a frame?

    wants      what a network asks of a graph, and how wide that is
    material   what a network is given of a body's material
    layout     which coordinates, state and further fields of a set are seen and predicted
    encoding   random walks as the place of a node or segment in its graph
    contact    pairs of nodes that are near each other
    levels     coarser graphs above a mesh
    graph      nodes, mesh edges, contact edges, segments, and their features
    flow       the same of a flow
    alike      batches padded to few sizes
"""
