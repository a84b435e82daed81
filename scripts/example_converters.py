"""Converters with gated switches, for scripts/make_examples."""
import numpy as np
from example_files import made, numbers
from example_references import converter_solution


def converter(name, title, unknowns, difficulty, circuit, gate, modes, states, step_error):
    """Writes the scene of a converter.

    circuit: values of the circuit, (name, value, comment). gate: (duty, frequency, periods). modes: (A, c) with the switch
    on and off. states: the lines of A, B, f and N, the start, names, units, and the current of the diode as a function of x.
    """
    duty, frequency, periods = gate
    x = converter_solution(*modes, duty, 1 / frequency, periods, 1 / (300 * frequency), states["x0"], states["diode"])
    parameters = "\n".join(f"{key} = {value:g}{comment}" for key, value, comment in circuit)
    kind = title.split(" ", 1)[1].split(" with")[0]
    made[f"{name}.toml"] = f"""\
# {title}
#
{unknowns}
# A gated switch carries a current between 0 and I_max u(t), where u is 1 (on) or 0 (off). Its voltage p - q is positive
# only while the current is at its upper bound, and negative only while it is 0:
#     0 <= p ⊥ I_max u(t) - i_s >= 0,   0 <= q ⊥ i_s >= 0.
# The diode is 0 <= i_d ⊥ its reverse voltage >= 0.
#
{difficulty}
name = "{name}"
description = "{kind}: a switch whose current lies between 0 and I_max u(t), and a diode"

[parameters]
{parameters}
duty = {duty:g}
frequency = {frequency:g} # hertz
I_max = 100      # ampere, more than ever flows
shift = "1/(300*frequency)"

[definitions]
u = "pulse(t - shift, 1/frequency, duty/frequency)"

[dynamics]
A = {states["A"]}
B = {states["B"]}
f = {states["f"]}
x0 = {numbers(states["x0"])}

[complementarity]
N = {states["N"]}
M = [[0, -1, 1], [1, 0, 0], [-1, 0, 0]]
g = [0, "I_max*u", 0]
class = "PSD"

[time]
T = "{periods}/frequency"
steps = {100 * periods}

[names]
x = {states["names"]}
y = ["i_d", "p", "q"]
w = ["v_d", "i_left", "i_s"]

[units]
t = "s"
x = {states["units"]}
y = ["A", "V", "V"]
w = ["V", "A", "A"]

[output]
states = "all"

# The edges of the gate lie at a third of a step. {step_error}
[reference]
t = "{periods}/frequency"
x = {numbers(x, 15)}
tolerance = 5e-6
source = "both modes by their exponentials, {2 * periods + 1} intervals of continuous conduction"
"""


def boost():
    Vin, L, C, R = 10.0, 1e-4, 1e-4, 10.0
    source = np.array([Vin / L, 0])
    converter(
        "boost",
        "A boost converter with a gated switch and a diode, pulse-width modulated at 20 kHz.",
        "# x = (i of the coil, v of the capacitor); y = (i_d, p, q), w = (v - (p - q), I_max u - i_s, i_s), i_s = i - i_d.",
        "# Difficulty: M is skew and singular; w jumps with the gate. While the switch is off both bounds of its current are 0, and\n"
        "# p and q are known only by their difference.",
        [("Vin", Vin, "        # volt"), ("L", L, "       # henry"), ("C", C, "      # farad"), ("R", R, "         # ohm")],
        (0.4, 20000.0, 20),
        ((np.array([[0, 0], [0, -1 / (R * C)]]), source), (np.array([[0, -1 / L], [1 / C, -1 / (R * C)]]), source)),
        {
            "A": '[[0, 0], [0, "-1/(R*C)"]]',
            "B": '[[0, "-1/L", "1/L"], ["1/C", 0, 0]]',
            "f": '["Vin/L", 0]',
            "N": "[[0, 1], [-1, 0], [1, 0]]",
            "x0": np.array([2.0, 16.0]),
            "names": '["i", "v"]',
            "units": '["A", "V"]',
            "diode": lambda x: x[0],
        },
        "On a time point the current would follow its new bound within the step\n# before. Between edges a step of Radau IIA "
        "errs by (h/sqrt(L C))^4 / 72 = 1e-11 of the values, 2000 steps by 3e-7 V.",
    )


def cuk():
    Vin, L1, L2, C1, C2, R = 12.0, 2e-4, 3e-4, 2e-5, 1e-4, 8.0
    source = np.array([Vin / L1, 0, 0, 0])
    load = [0, 0, 1 / C2, -1 / (R * C2)]
    converter(
        "cuk",
        "A Cuk converter with a gated switch and a diode, pulse-width modulated at 25 kHz; the output voltage is negative.",
        "# x = (i1 of the input coil, v1 of the coupling capacitor, i2 of the output coil, v2 of the output); y = (i_d, p, q),\n"
        "# w = (v1 - (p - q), I_max u - i_s, i_s), i_s = i1 - i2 - i_d.",
        "# Difficulty: as boost.toml, with two oscillators of different periods.",
        [("Vin", Vin, "        # volt"), ("L1", L1, "      # henry"), ("L2", L2, ""), ("C1", C1, "       # farad"), ("C2", C2, ""),
         ("R", R, "           # ohm")],
        (0.45, 25000.0, 25),
        (
            (np.array([[0, 0, 0, 0], [0, 0, 1 / C1, 0], [0, -1 / L2, 0, -1 / L2], load]), source),
            (np.array([[0, -1 / L1, 0, 0], [1 / C1, 0, 0, 0], [0, 0, 0, -1 / L2], load]), source),
        ),
        {
            "A": '[[0, 0, 0, 0], [0, 0, "1/C1", 0], [0, "-1/L2", 0, "-1/L2"], [0, 0, "1/C2", "-1/(R*C2)"]]',
            "B": '[[0, "-1/L1", "1/L1"], ["1/C1", 0, 0], [0, "1/L2", "-1/L2"], [0, 0, 0]]',
            "f": '["Vin/L1", 0, 0, 0]',
            "N": "[[0, 1, 0, 0], [-1, 0, 1, 0], [1, 0, -1, 0]]",
            "x0": np.array([1.0, 20.0, -1.0, -9.0]),
            "names": '["i1", "v1", "i2", "v2"]',
            "units": '["A", "V", "A", "V"]',
            "diode": lambda x: x[0] - x[2],
        },
        "Between them a step of Radau IIA errs by (h omega)^4 / 72 = 2.5e-11 of the\n# values with the fastest frequency, "
        "omega = 1.6e4, 2500 steps by 1.3e-6 V.",
    )
