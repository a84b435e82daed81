#include "circuits/library.hpp"

namespace bromwich::circuits {

std::string_view library() {
  return R"(Library
* V(out) = A V(inp,inn) between Vmin and Vmax, without dynamics
.subckt opamp inp inn out PARAMS: A=1e5 Vmax=15 Vmin=-15
B1 out 0 V=limit({A}*V(inp,inn), {Vmin}, {Vmax})
.ends
* the same with the gain-bandwidth product GBW in Hz and the slew rate SR in V/s
.subckt opampgbw inp inn out PARAMS: A=1e5 GBW=1meg SR=1meg Vmax=15 Vmin=-15
B1 0 y I=limit({2*pi*GBW*1n}*V(inp,inn), {-SR*1n}, {SR*1n})
C1 y 0 1n
R1 y 0 {A/(2*pi*GBW*1n)}
D1 y high DC
D2 low y DC
V1 high 0 {Vmax}
V2 low 0 {Vmin}
B2 out 0 V=V(y)
.model DC D(Ron=1m Vfwd=0)
.ends
* Vhigh from V(inp,inn) > Vt + Vh on, Vlow from V(inp,inn) < Vt - Vh on
.subckt comparator inp inn out PARAMS: Vhigh=5 Vlow=0 Vt=0 Vh=1m
B1 out 0 V={Vlow}+{Vhigh-Vlow}*schmitt(V(inp,inn), {Vt-Vh}, {Vt+Vh})
.ends
* V(speed) is the speed in rad/s; a current out of this node is a torque of the load in N m
.subckt dcmotor p n speed PARAMS: R=1 L=1m k=0.1 J=1m b=1u
Vs p a 0
R1 a x {R}
L1 x e {L}
E1 e n speed 0 {k}
F1 0 speed Vs {k}
C1 speed 0 {J}
R2 speed 0 {1/b}
.ends
* conducts from V(g,k) > Vgt on, until its current falls below Ih
.subckt thyristor a k g PARAMS: Ron=1m Roff=1meg Vf=0 Vgt=1 Ih=1m
S1 a k g k TH
.model TH SCR(Ron={Ron} Roff={Roff} Vfwd={Vf} Vgt={Vgt} Ih={Ih})
.ends
.subckt triac b a g PARAMS: Ron=1m Roff=1meg Vf=0 Vgt=1 Ih=1m
S1 b a g a TH
S2 a b g a TH
.model TH SCR(Ron={Ron} Roff={Roff} Vfwd={Vf} Vgt={Vgt} Ih={Ih})
.ends
* a switch with a body diode; nothing else of a transistor
.subckt mosfet d g s PARAMS: Ron=10m Roff=1meg Vt=2 Vf=0.7 Rd=10m
S1 d s g s SM
D1 s d DM
.model SM SW(Ron={Ron} Roff={Roff} Vt={Vt} Vh=0)
.model DM D(Ron={Rd} Roff={Roff} Vfwd={Vf})
.ends
* a switch with the line Vce + Ron i, and a diode beside it
.subckt igbt c g e PARAMS: Ron=10m Roff=1meg Vt=5 Vce=1 Vf=0.8 Rd=10m
S1 c x g e SI
D1 x e DI
D2 e c DA
.model SI SW(Ron={Ron} Roff={Roff} Vt={Vt} Vh=0)
.model DI D(Ron=0 Roff={Roff} Vfwd={Vce})
.model DA D(Ron={Rd} Roff={Roff} Vfwd={Vf})
.ends
)";
}

}  // namespace bromwich::circuits
