#pragma once
// Properties of a scene before it is solved, as text.

#include "core/scene/scene.hpp"

#include <string>

namespace bromwich::app {

/// The class of M and its justification: "P (H+)", "PSD", ...; of its Schur complement if free rows can be eliminated.
std::string matrix_class(const Scene&);

/// The spectrum, for example "real, moduli 0.04 to 12.8"; "not computed" for dense scenes of more than 400 states.
std::string spectrum_text(const Scene&);

}  // namespace bromwich::app
