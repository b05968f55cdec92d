"""What the paper compares M4GN with, and Transolver, each from its equations.

    mgn         message passing alone
    gcn         graph convolutions that see no edges
    geometry    edges of coarser graphs, as those of the mesh are seen
    g_u_net     message passing on fewer and fewer nodes, which the network picks itself
    bsms        message passing on coarser and coarser graphs, made beforehand
    eagle       message passing, then attention among clusters that a recurrent net has read
    transolver  attention among soft slices of the body, no edges
"""
