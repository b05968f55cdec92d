"""A body in motion, with inertia.

    inertia    whether it matters
    impact     contact that makes no energy
    dynamics   one time step after the other
"""
