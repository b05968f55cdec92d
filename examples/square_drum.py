"""The lowest eigenvalue of the Laplace operator on a unit square that is held along its edge is 2 pi^2.

Laplacian modes depend on the shape of a domain alone, not on a material: by them a flow channel can be cut into
segments. With Body(shape="channel") in place of the square the same call gives those of the channel around a
cylinder.
"""

import numpy as np

from physics import Body, laplacian_modes

square = Body(shape="plate", length=1.0, width=1.0, cells=(16, 16), cell="quadrilateral", order=2)
modes = laplacian_modes(square, count=4)
expected = np.pi**2 * np.array([2, 5, 5, 8])  # pi^2 (m^2 + n^2)

for found, exact in zip(modes.eigenvalues, expected, strict=True):
    print(f"{found:.5f} 1/m2, exactly {exact:.5f}")
print("modes that belong together:", [[i + 1 for i in members] for members in modes.clusters])
assert np.allclose(modes.eigenvalues, expected, rtol=1e-4)
assert [len(members) for members in modes.clusters] == [1, 2, 1]  # the square has a pair
