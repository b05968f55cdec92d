"""How fine must a scene be modelled for an error that is asked for, and what error has it then?

    estimate  the error of a sequence of solutions, by the order that is seen in it
    meshes/   the meshes that a body may have, from coarse to fine along each direction
    pilot     a scene solved at a few poses on one of them, as values at fixed points
    climb     from the coarsest mesh of one order up to the one that keeps the error
    choose    the cheapest of them that keeps the error
    between   all steps on it, of which mostly few are solved
    motion    mesh and steps of time of a body in motion
    frequency the same for the modes of a body
    table     what was chosen and what each choice makes of the error, in rows
    answer    the whole way: chosen, solved and judged
"""
