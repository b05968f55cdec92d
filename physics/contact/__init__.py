"""Where are the obstacles, and what do they do to the body?

    obstacles    one on its path
    shapes       what they look like, a class for each shape: distance, normal, curvature, extents
    tool         any closed surface of triangles, its distance made smooth
    closed       the exact distance to such a surface
    surfaces     their surfaces as meshes
    points       where on the body's surface it is felt
    several      many of them, felt as one
    conditions   the contact condition gap >= 0, p >= 0, p gap = 0, at points of the body's surface
    touch        contact condensed to the nodes that it takes part in
"""
