"""The reduced-order model: the same body in few shapes, by numpy and scipy alone; a rival of finite elements, and an estimate that a
network may correct.

    elastic       forces and stiffness in numpy, without dolfinx
    space         the energy as a polynomial of the amplitudes
    pose          pressed by the obstacle at one pose: a small space, local yielding, contact
    quasistatic   a state from the obstacle's pose alone
"""
