"""Converters with gated switches, for scripts/make_examples."""
import numpy as np
from example_files import made, numbers
from example_references import BridgeOfThreePhases, converter_solution, discontinuous_converter_solution


def converter(name, title, unknowns, difficulty, circuit, gate, modes, states, tolerance):
    """Writes the scene of a converter.

    circuit: values of the circuit, (name, value, comment). gate: (duty, frequency, periods). modes: (A, c) with the switch
    on, off and, in discontinuous conduction, idle. states: the lines of A, B, f, N and, if not those of a boost converter,
    M and g; the start, names, units, and the current of the diode as a function of x.
    """
    duty, frequency, periods = gate
    solution = converter_solution if len(modes) == 2 else discontinuous_converter_solution
    x = solution(*modes, duty, 1 / frequency, periods, 1 / (300 * frequency), states["x0"], states["diode"])
    located = (
        f"both modes by their exponentials, {2 * periods + 1} intervals of continuous conduction"
        if len(modes) == 2
        else f"three modes by their exponentials, {periods} zeros of the current located"
    )
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
M = {states.get("M", "[[0, -1, 1], [1, 0, 0], [-1, 0, 0]]")}
g = {states.get("g", '[0, "I_max*u", 0]')}
class = "PSD"

[time]
T = "{periods}/frequency"
tol = 1e-4

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

[reference]
t = "{periods}/frequency"
x = {numbers(x, 15)}
tolerance = {tolerance}
source = "{located}"
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
        "2e-3",
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
        "3e-3",
    )


def flyback():
    Vin, L, C, R, n = 24.0, 1e-4, 1e-4, 20.0, 0.25
    leak, source = -1 / (R * C), np.array([Vin / L, 0])
    converter(
        "flyback",
        "A flyback converter with a gated switch and a diode, pulse-width modulated at 50 kHz, in discontinuous conduction.",
        "# x = (i of magnetisation, seen from the input, v of the capacitor); y = (i_d, p, q),\n"
        "# w = (v + n (V_in - (p - q)), I_max u - i_s, i_s), i_s = i - n i_d: n is the ratio of windings, output to input.",
        "# Difficulty: as boost.toml. In every period the diode stops at a time that no source tells, and from then on nothing\n"
        "# conducts: i = 0 is held by both bounds of the switch and the diode until the gate opens again.",
        [("Vin", Vin, "        # volt"), ("L", L, "       # henry"), ("C", C, "      # farad"), ("R", R, "         # ohm"),
         ("n", n, "       # windings of the output over those of the input")],
        (0.4, 50000.0, 20),
        (
            (np.array([[0, 0], [0, leak]]), source),
            (np.array([[0, -1 / (n * L)], [1 / (n * C), leak]]), np.zeros(2)),
            (np.array([[0, 0], [0, leak]]), np.zeros(2)),
        ),
        {
            "A": '[[0, 0], [0, "-1/(R*C)"]]',
            "B": '[[0, "-1/L", "1/L"], ["1/C", 0, 0]]',
            "f": '["Vin/L", 0]',
            "N": "[[0, 1], [-1, 0], [1, 0]]",
            "M": '[[0, "-n", "n"], ["n", 0, 0], ["-n", 0, 0]]',
            "g": '["n*Vin", "I_max*u", 0]',
            "x0": np.array([0.0, 13.0]),
            "names": '["i", "v"]',
            "units": '["A", "V"]',
            "diode": lambda x: x[0],
        },
        "8e-3",
    )


def three_phase():
    V, f, L, C, R, T = 325.0, 50.0, 1e-3, 1e-3, 50.0, 0.04
    x, switches = BridgeOfThreePhases(V, 2 * np.pi * f, L, C, R).solve(np.zeros(4), T, 2e-6)
    made["three-phase.toml"] = f"""\
# A bridge of six diodes between three phases with line inductances and a capacitor with a load, switched on at no charge.
#
# x = (the line currents i_a, i_b, i_c, v of the capacitor). Each phase has one diode to the positive rail, which carries
# i_k+, and one from the negative rail, which carries i_k-; u_k is the potential of the line end above the negative rail:
#     i_k = i_k+ - i_k-,   0 <= u_k ⊥ i_k- >= 0,   0 <= i_k+ ⊥ v - u_k >= 0.
# y = (u_a, u_b, u_c, i_a+, i_b+, i_c+), w = (i_a-, i_b-, i_c-, v - u_a, v - u_b, v - u_c). The star point of the phases
# floats, so that the currents add up to zero.
# Difficulty: M is skew and singular. Currents commutate from phase to phase within part of a step, the inrush is followed
# by gaps in which no diode conducts: then u is known only up to a common value, and y is one of several solutions.
name = "three-phase"
description = "three-phase rectifier: six diodes, line inductances, a capacitor that is charged from zero"

[parameters]
V = {V:g}        # volt, amplitude of a phase
frequency = {f:g}  # hertz
L = {L:g}       # henry
C = {C:g}       # farad
R = {R:g}         # ohm
s = "2*pi*frequency"

[dynamics]
A = [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, "-1/(R*C)"]]
B = [["-2/(3*L)", "1/(3*L)", "1/(3*L)", 0, 0, 0], ["1/(3*L)", "-2/(3*L)", "1/(3*L)", 0, 0, 0],
     ["1/(3*L)", "1/(3*L)", "-2/(3*L)", 0, 0, 0], [0, 0, 0, "1/C", "1/C", "1/C"]]
f = ["V/L*sin(s*t)", "V/L*sin(s*t - 2*pi/3)", "V/L*sin(s*t - 4*pi/3)", 0]
x0 = [0, 0, 0, 0]

[complementarity]
N = [[-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1]]
M = [[0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1],
     [-1, 0, 0, 0, 0, 0], [0, -1, 0, 0, 0, 0], [0, 0, -1, 0, 0, 0]]
class = "PSD"

[time]
T = {T:g}
tol = 1e-4

[names]
x = ["i_a", "i_b", "i_c", "v"]
y = ["u_a", "u_b", "u_c", "i_ap", "i_bp", "i_cp"]

[units]
t = "s"
x = ["A", "A", "A", "V"]

[output]
states = "all"

[reference]
t = {T:g}
x = {numbers(x, 12)}
tolerance = 1e-1
source = "Runge-Kutta 4 with steps of 2e-6 between {switches} located switches; see scripts/make_examples"
"""
