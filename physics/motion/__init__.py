"""A body that swings through time.

    inertia    whether it matters
    impact     contact that makes no energy
    dynamics   one step of time after the other
"""
