#pragma once
// .model cards.

#include "circuits/netlist.hpp"

#include <utility>

namespace bromwich::circuits {

struct Model {
  Card card;
  std::string type;                          ///< d, sw, csw, or another
  std::map<std::string, std::string> given;  ///< parameters by name
};

/// .model NAME TYPE(name=value ...)
Model read_model(const Card&);

/// A junction model (Is N Rs BV) becomes a straight line, which `straightened` says.
DiodeModel diode_model(const Model&, const Parameters&);
/// .model NAME SCR(Ron= Roff= Vfwd= Vgt= Ih= Vdrm=)
std::pair<DiodeModel, ThyristorModel> thyristor_model(const Model&, const Parameters&);
/// `notes`: gets a line where a negative Vh is taken as its size.
SwitchModel switch_model(const Model&, const Parameters&, std::vector<std::string>& notes);

}  // namespace bromwich::circuits
