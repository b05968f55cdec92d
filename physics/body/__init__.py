"""What energy, forces and stiffness has a deformed body?

    material     the strain-energy densities W(F)
    element      where the energy of a cell is sampled
    kernel       W and its derivatives for several cells at once, compiled
    elasticity   energy, forces, tangent stiffness and mass of a body
    lumped       the same with a lumped mass added to the stiffness
    stress       Piola-Kirchhoff, Cauchy and von Mises stress, at cells' centres and nodes
    pressure     pressure along the normal of a face, dead or following it
    schedule     how far loads and supports are, by tables, and supports that turn
    supports     what is held and loaded, and which rigid motions that leaves
"""
