"""Identifies the resistance behind a diode from a noisy voltage: a Jacobian by JAX, least squares by Gauss and Newton.

    pip install jax
    python examples/jax_resistance.py
"""

import jax
import jax.numpy as jnp
import numpy as np
from bromwich.jax import solve

jax.config.update("jax_enable_x64", True)

C, L, true = 1e-6, 1e-2, 1000.0  # F, H and ohm: a resonator, a diode and the resistor
scene = dict(A=np.array([[0, -1 / C], [1 / L, 0]]), B=np.array([[-1 / C], [0]]), N=np.array([[-1.0, 0]]))


def voltage(R):
    y, x, w = solve(**scene, M=jnp.reshape(R, (1, 1)), x0=np.array([10.0, 0]), T=5e-3, steps=2000)
    return x[50::50, 0]


measured = voltage(true) + 0.05 * np.random.default_rng(1).normal(size=40)
starts = jnp.array([500.0, 1500.0, 3000.0])
misfits = jax.vmap(lambda R: jnp.sum((voltage(R) - measured) ** 2))(starts)  # all of them in one solve
R = starts[jnp.argmin(misfits)]
for _ in range(6):
    J = jax.jacrev(voltage)(R)
    R = R + J @ (measured - voltage(R)) / (J @ J)
sigma = jnp.sqrt(jnp.sum((voltage(R) - measured) ** 2) / (measured.size - 1) / (J @ J))
print(f"resistance {float(R):.1f} +- {2 * float(sigma):.1f} ohm, of which the data were made with {true:.0f}")
