"""What is the body's mesh, where are its places, is it sound?

    cell       everything that depends on the type of a cell
    formats/   what a mesh file says: a module for each format
    sound/     whether a mesh may be believed: each cell, how cells fit together, curved sides
    places     what a place is called, and places by coordinates
    mesh       points, cells, outer surface, named places
    shapes/    meshes of beams, plates and channels
    files, build    meshes of files, read by the module for their ending; the mesh that a body asks for
    quality    how good a deformed mesh is, against a true one and by itself
    transfer   displacements carried from one mesh to another
    refine     the same mesh on cells of half the size
    second     the same mesh with cells of second order
"""
