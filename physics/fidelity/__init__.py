"""How good is a prediction?

    figures   what each figure is called, its unit, what it is, and the verdict from all of them
    verify    its error, residual force, energy, penetration, reaction and mesh, against the scene it is of
    starts    where the Newton steps of a frame begin
    currents  the equations of a flow at its stored nodes
    carried   a stored flow at other points
    flow      how good a predicted flow is
    correct   what Newton steps make of a prediction
    along     a whole path corrected at some of its frames
"""
