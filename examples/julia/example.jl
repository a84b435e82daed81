# x' = -x + y,  0 <= y ⊥ x + y - 1 >= 0,  x(0) = 0:  x = (1 - exp(-2t))/2, y = 1 - x
include("Bromwich.jl")
using .Bromwich

scene = Scene(A = [-1.0;;], B = [1.0;;], N = [1.0;;], M = [1.0;;], x0 = [0.0], g = ["-1"], T = 2)
r = solve(scene, "tol=1e-8")
exact = (1 .- exp.(-2 .* r.t)) ./ 2
println("$(r.status) by $(r.method): error of x $(maximum(abs.(r.x[:, 1] .- exact)))")
@assert maximum(abs.(r.x[:, 1] .- exact)) < 1e-8  # the tolerance, relative to x < 1

signorini = solve(Scene("signorini", "Q=15"), "steps=200")
@assert signorini.status == "solved"
