% Two scenes in Octave or MATLAB: one of arrays with a closed form, and a buck converter from a netlist. Run it where
% bromwich_solve is compiled (its source says how), with the variable `netlist`, the path of examples/circuits/buck.cir.

% x' = -x + y,  0 <= y ⊥ x + y - 1 >= 0,  x(0) = 0:  x = (1 - exp(-2t))/2, y = 1 - x
scene = struct('A', -1, 'B', 1, 'N', 1, 'M', 1, 'T', 2, 'x0', 0);
scene.g = {'-1'};
r = bromwich_solve(scene, 'tol=1e-8');
exact = (1 - exp(-2 * r.t)) / 2;
printf('%s by %s: error of x %.1e\n', r.status, r.method, max(abs(r.x - exact)));
assert(max(abs(r.x - exact)) < 1e-8);  % the tolerance, relative to x < 1

scene.g = -1;  % a constant
constant = bromwich_solve(scene, 'tol=1e-8');
assert(abs(constant.x(end) - exact(end)) < 1e-8);

circuit = bromwich_solve(netlist);
out = find(strcmp(circuit.names, 'V(out)'));
printf('%s: V(out) ends at %.3f V\n', circuit.status, circuit.outputs(end, out));
assert(strcmp(circuit.status, 'solved') && circuit.outputs(end, out) > 0);

% A refusal has the line of the library.
refusal = '';
try
  bromwich_solve(scene, 'step=4');
catch refused
  refusal = refused.message;
end
assert(~isempty(strfind(refusal, 'did you mean ''steps''?')), refusal);
