#pragma once
#include <nlohmann/json_fwd.hpp>

#include "proof/foreign_laws/kinds.hpp"
#include "proof/generator/case.hpp"

namespace isorig::proof::foreign {

struct Concealed {
  std::string law;
  double strength = 0.0;
  double size = 1.0;
  Shape shape;
  double residual_over_noise = 0.0;  ///< alone, after the nominal refit
};

/// A case of the second generator. CasePlan::effects holds laws here.
struct Case {
  std::string name;
  CasePlan plan;
  std::string nominal;  ///< slse1 or slse2
  Rig clean;
  Rig train_rig;
  Rig heldout_rig;  ///< mounted anew: without what belongs to one session
  Path train{1.0};
  Path heldout{1.0};
  FrameRates rates;
  Instruments instruments;
  std::vector<Concealed> concealed;
  std::vector<Concealed> background;
  double residual_over_noise = 0.0;
  double background_over_noise = 0.0;
};

/// Of 24: 6 nulls, 9 singles, 3 pairs, 1 triple, 2 over a background, 3 that nothing names. 600 hold 150 nulls.
[[nodiscard]] std::vector<CasePlan> plan_study(std::uint64_t seed, std::size_t count);
[[nodiscard]] Case draw_case(std::uint64_t seed, std::size_t number, const CasePlan& plan);
[[nodiscard]] MadeRecording record(const Case& drawn, Part part, std::uint64_t seed);
[[nodiscard]] nlohmann::ordered_json label_of(const Case& drawn);

}  // namespace isorig::proof::foreign
