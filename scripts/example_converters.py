"""Converters with gated switches, for scripts/make_examples."""
import numpy as np
from example_files import made, numbers
from example_references import converter_solution

GATED_SWITCH = """\
# A gated switch carries a current between 0 and I_max u(t), where u is 1 (on) or 0 (off). Its voltage p - q is positive
# only while the current is at its upper bound, and negative only while it is 0:
#     0 <= p ⊥ I_max u(t) - i_s >= 0,   0 <= q ⊥ i_s >= 0.
# The diode is 0 <= i_d ⊥ its reverse voltage >= 0.
"""


def boost():
    Vin, L, C, R, duty, frequency, periods = 10.0, 1e-4, 1e-4, 10.0, 0.4, 20000.0, 20
    on = (np.array([[0, 0], [0, -1 / (R * C)]]), np.array([Vin / L, 0]))
    off = (np.array([[0, -1 / L], [1 / C, -1 / (R * C)]]), np.array([Vin / L, 0]))
    x0 = np.array([2.0, 16.0])
    x = converter_solution(on, off, duty, 1 / frequency, periods, 1 / (300 * frequency), x0, lambda x: x[0])
    made["boost.toml"] = f"""\
# A boost converter with a gated switch and a diode, pulse-width modulated at 20 kHz.
#
# x = (i of the coil, v of the capacitor); y = (i_d, p, q), w = (v - (p - q), I_max u - i_s, i_s), i_s = i - i_d.
{GATED_SWITCH}#
# Difficulty: M is skew and singular; w jumps with the gate. While the switch is off both bounds of its current are 0, and
# p and q are known only by their difference.
name = "boost"
description = "boost converter: a switch whose current lies between 0 and I_max u(t), and a diode"

[parameters]
Vin = {Vin:g}        # volt
L = {L:g}       # henry
C = {C:g}      # farad
R = {R:g}         # ohm
duty = {duty:g}
frequency = {frequency:g} # hertz
I_max = 100      # ampere, more than ever flows
shift = "1/(300*frequency)"

[definitions]
u = "pulse(t - shift, 1/frequency, duty/frequency)"

[dynamics]
A = [[0, 0], [0, "-1/(R*C)"]]
B = [[0, "-1/L", "1/L"], ["1/C", 0, 0]]
f = ["Vin/L", 0]
x0 = {numbers(x0)}

[complementarity]
N = [[0, 1], [-1, 0], [1, 0]]
M = [[0, -1, 1], [1, 0, 0], [-1, 0, 0]]
g = [0, "I_max*u", 0]
class = "PSD"

[time]
T = "{periods}/frequency"
steps = 2000

[names]
x = ["i", "v"]
y = ["i_d", "p", "q"]
w = ["v_d", "i_left", "i_s"]

[units]
t = "s"
x = ["A", "V"]
y = ["A", "V", "V"]
w = ["V", "A", "A"]

[output]
states = "all"

# The edges of the gate lie at a third of a step. On a time point the current would follow its new bound within the step
# before. Between edges a step of Radau IIA errs by (h/sqrt(L C))^4 / 72 = 1e-11 of the values, 2000 steps by 3e-7 V.
[reference]
t = "{periods}/frequency"
x = {numbers(x, 15)}
tolerance = 5e-6
source = "both modes by their exponentials, {2 * periods + 1} intervals of continuous conduction"
"""


def cuk():
    Vin, L1, L2, C1, C2, R = 12.0, 2e-4, 3e-4, 2e-5, 1e-4, 8.0
    duty, frequency, periods = 0.45, 25000.0, 25
    source = np.array([Vin / L1, 0, 0, 0])
    load = [0, 0, 1 / C2, -1 / (R * C2)]
    on = (np.array([[0, 0, 0, 0], [0, 0, 1 / C1, 0], [0, -1 / L2, 0, -1 / L2], load]), source)
    off = (np.array([[0, -1 / L1, 0, 0], [1 / C1, 0, 0, 0], [0, 0, 0, -1 / L2], load]), source)
    x0 = np.array([1.0, 20.0, -1.0, -9.0])
    x = converter_solution(on, off, duty, 1 / frequency, periods, 1 / (300 * frequency), x0, lambda x: x[0] - x[2])
    made["cuk.toml"] = f"""\
# A Cuk converter with a gated switch and a diode, pulse-width modulated at 25 kHz; the output voltage is negative.
#
# x = (i1 of the input coil, v1 of the coupling capacitor, i2 of the output coil, v2 of the output); y = (i_d, p, q),
# w = (v1 - (p - q), I_max u - i_s, i_s), i_s = i1 - i2 - i_d.
{GATED_SWITCH}#
# Difficulty: as boost.toml, with two oscillators of different periods.
name = "cuk"
description = "Cuk converter: a switch whose current lies between 0 and I_max u(t), and a diode"

[parameters]
Vin = {Vin:g}        # volt
L1 = {L1:g}      # henry
L2 = {L2:g}
C1 = {C1:g}       # farad
C2 = {C2:g}
R = {R:g}           # ohm
duty = {duty:g}
frequency = {frequency:g} # hertz
I_max = 100      # ampere, more than ever flows
shift = "1/(300*frequency)"

[definitions]
u = "pulse(t - shift, 1/frequency, duty/frequency)"

[dynamics]
A = [[0, 0, 0, 0], [0, 0, "1/C1", 0], [0, "-1/L2", 0, "-1/L2"], [0, 0, "1/C2", "-1/(R*C2)"]]
B = [[0, "-1/L1", "1/L1"], ["1/C1", 0, 0], [0, "1/L2", "-1/L2"], [0, 0, 0]]
f = ["Vin/L1", 0, 0, 0]
x0 = {numbers(x0)}

[complementarity]
N = [[0, 1, 0, 0], [-1, 0, 1, 0], [1, 0, -1, 0]]
M = [[0, -1, 1], [1, 0, 0], [-1, 0, 0]]
g = [0, "I_max*u", 0]
class = "PSD"

[time]
T = "{periods}/frequency"
steps = 2500

[names]
x = ["i1", "v1", "i2", "v2"]
y = ["i_d", "p", "q"]
w = ["v_d", "i_left", "i_s"]

[units]
t = "s"
x = ["A", "V", "A", "V"]
y = ["A", "V", "V"]
w = ["V", "A", "A"]

[output]
states = "all"

# The edges of the gate lie at a third of a step. Between them a step of Radau IIA errs by (h omega)^4 / 72 = 2.5e-11 of the
# values with the fastest frequency, omega = 1.6e4, 2500 steps by 1.3e-6 V.
[reference]
t = "{periods}/frequency"
x = {numbers(x, 15)}
tolerance = 5e-6
source = "both modes by their exponentials, {2 * periods + 1} intervals of continuous conduction"
"""
