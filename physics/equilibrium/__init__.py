"""One equilibrium, and a path of them.

    balance         what balances what in a scene
    small_strain    whether linear elasticity is enough
    newton          one equilibrium, with a factor that is kept as long as it pays
    mixing          Anderson acceleration of Newton steps with an old factor
    snap            where a path ends: the body moves to the next equilibrium
    extrapolation   where the next equilibrium is looked for
    journal         a path on disk, to go on from after a kill
    path            all of it, step by step
"""
