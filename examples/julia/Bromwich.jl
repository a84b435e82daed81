"""
The C interface of bromwich by `ccall`: scenes from arrays or files, results as arrays.

The library is found by its name, `libbromwich`, or in the environment variable `BROMWICH_LIBRARY`.
"""
module Bromwich

export Scene, solve

const library = get(ENV, "BROMWICH_LIBRARY", "libbromwich")
const by_columns = Cint(1)

function need(code::Cint)
    code == 0 || error(unsafe_string(ccall((:bromwich_error, library), Cstring, ())))
    return nothing
end

mutable struct Scene
    handle::Ptr{Cvoid}
    function Scene(handle::Ptr{Cvoid})
        scene = new(handle)
        finalizer(s -> ccall((:bromwich_scene_free, library), Cvoid, (Ptr{Cvoid},), s.handle), scene)
    end
end

"A scene of a file .toml, a netlist, or the name of a built-in scene; settings such as \"R=500\"."
function Scene(name::AbstractString, settings::AbstractString = "")
    handle = Ref{Ptr{Cvoid}}(C_NULL)
    need(ccall((:bromwich_scene_read, library), Cint, (Cstring, Cstring, Ref{Ptr{Cvoid}}), name, settings, handle))
    return Scene(handle[])
end

"""
    Scene(; A, B, N, M, x0, T, f, g, E)

E x' = A x + B y + f(t), 0 <= y ⊥ N x + M y + g(t) >= 0; f and g are lists of expressions of t.
"""
function Scene(; A::AbstractMatrix, M::AbstractMatrix, T::Real, f = nothing, g = nothing, arrays...)
    handle = Ref{Ptr{Cvoid}}(C_NULL)
    need(ccall((:bromwich_scene_new, library), Cint, (Int64, Int64, Cdouble, Ref{Ptr{Cvoid}}),
               size(A, 1), size(M, 1), T, handle))
    scene = Scene(handle[])
    for (name, values) in pairs((; A, M, arrays...))
        dense = Array{Cdouble}(values)
        need(ccall((:bromwich_scene_set, library), Cint,
                   (Ptr{Cvoid}, Cstring, Ptr{Cdouble}, Int64, Int64, Cint),
                   scene.handle, String(name), dense, size(dense, 1), size(dense, 2), by_columns))
    end
    for (name, texts) in ("f" => f, "g" => g)
        texts === nothing && continue
        need(ccall((:bromwich_scene_set_expressions, library), Cint, (Ptr{Cvoid}, Cstring, Ptr{Cstring}, Int64),
                   scene.handle, name, collect(String, texts), length(texts)))
    end
    return scene
end

"A copy of an array of a result, rows x columns."
function array(result::Ptr{Cvoid}, name::AbstractString)
    first = Ref{Ptr{Cdouble}}(C_NULL)
    rows, columns = Ref{Int64}(0), Ref{Int64}(0)
    need(ccall((:bromwich_result_array, library), Cint,
               (Ptr{Cvoid}, Cstring, Ref{Ptr{Cdouble}}, Ref{Int64}, Ref{Int64}), result, name, first, rows, columns))
    return permutedims(unsafe_wrap(Array, first[], (columns[], rows[])))
end

text(result, name) =
    unsafe_string(ccall((:bromwich_result_text, library), Cstring, (Ptr{Cvoid}, Cstring), result, name))

"Solves a scene, with options such as \"tol=1e-6 states=all\"; returns status, method, warning, t, y, w, x, switches."
function solve(scene::Scene, options::AbstractString = "")
    result = Ref{Ptr{Cvoid}}(C_NULL)
    GC.@preserve scene need(ccall((:bromwich_solve, library), Cint,
                                  (Ptr{Cvoid}, Cstring, Ptr{Cvoid}, Ref{Ptr{Cvoid}}),
                                  scene.handle, options, C_NULL, result))
    try
        return (status = text(result[], "status"), method = text(result[], "method"),
                warning = text(result[], "warning"), t = vec(array(result[], "t")), y = array(result[], "y"),
                w = array(result[], "w"), x = array(result[], "x"), switches = array(result[], "switches"))
    finally
        ccall((:bromwich_result_free, library), Cvoid, (Ptr{Cvoid},), result[])
    end
end

end
