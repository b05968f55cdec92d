"""One equilibrium, and a path of them.

    balance         what balances what in a scene
    state           what an equilibrium is, and where the next one is looked for
    tangent         the linear algebra of a Newton step, contact included: a factor that is kept, and when it is
                    renewed, or conjugate gradients
    mixing          Anderson acceleration of Newton steps with an old factor
    stability       when a state is checked for stability
    newton          one equilibrium
    small_strain    whether linear elasticity (small strain) is enough
    snap            where a path ends: the body moves to the next equilibrium
    path            all of it, step by step
"""
