"""What does a mesh file say? One module for each family of formats, all giving the same thing.

    raw      what a file says: nodes, blocks of cells, groups, in the file's own numbering
    gmsh     .msh 2.2, 4.0 and 4.1, text and binary
    abaqus   .inp, with sets of sets, generated sets and surfaces
    nastran  .bdf, .nas and .fem, with property numbers
    su2      .su2, with markers by name
    xdmf     .xdmf of several grids, as dolfinx writes meshes with their tags
    drawing  .step, .iges, .brep and gmsh's .geo, which have no cells and are cut by gmsh
    others   whatever else meshio reads: .vtu, .vtk, .med, .mesh and more
"""
