"""The same body in few shapes.

    model         the scene's equations in modes and their derivatives, solved step by step
    elastic       energy and stress in numpy, without dolfinx
    space         the energy as a polynomial of the amplitudes
    pose          pressed by the obstacle at one pose: a small space, local yielding, contact
    quasistatic   a state from the obstacle's pose alone, for a network to correct
"""
