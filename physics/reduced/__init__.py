"""The same body in few shapes.

    model         the scene's equations in modes and their derivatives, solved step by step
    elastic       energy and stress in numpy, without dolfinx
    space         the energy as a polynomial of the amplitudes
    quasistatic   a state from the obstacle's pose alone, for a network to correct
"""
