#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "c_abi.hpp"
#include "isorig_model.h"
#include "protocol/compile.hpp"

struct isorig_plan {
  std::vector<isorig::protocol::Step> steps;
  std::string text;  ///< of the step that was asked for last
};

namespace {

using namespace isorig;
using c_abi::guarded, c_abi::require;

/// Of a ramp with its direction, of a wave its peak; 0 of what does not move.
double velocity_mm_s(const protocol::Step& s) {
  if (s.kind == protocol::StepKind::kWave) return s.velocity_mm_s;
  if (s.kind == protocol::StepKind::kRamp)
    return std::copysign(s.velocity_mm_s, s.position_after_mm - s.position_before_mm);
  return 0.0;
}

}  // namespace

extern "C" {

isorig_plan* isorig_plan_new(const char* toml, const char* name) {
  return guarded(
      [&] {
        require(toml, "the text of the protocol");
        require(name, "its name");
        return new isorig_plan{protocol::compile(base::TomlDocument::parse_text(toml, name)).steps, {}};
      },
      nullptr);
}

void isorig_plan_free(isorig_plan* plan) {
  delete plan;
}

size_t isorig_plan_count(const isorig_plan* plan) {
  return plan->steps.size();
}

int isorig_plan_step(isorig_plan* plan, size_t index, isorig_step* out) {
  return guarded(
      [&] {
        require(plan, "the plan");
        require(out, "the place for the step");
        if (index >= plan->steps.size())
          throw std::out_of_range("the plan has " + std::to_string(plan->steps.size()) +
                                  " steps, counted from 0; there is no " + std::to_string(index));
        const protocol::Step& s = plan->steps[index];
        plan->text = protocol::describe(s);
        *out = {.kind = protocol::name_of(s.kind),
                .text = plan->text.c_str(),
                .from_mm = s.position_before_mm,
                .to_mm = s.position_after_mm,
                .velocity_mm_s = velocity_mm_s(s),
                .pressure_psi = s.pressure_psi};
        return 0;
      },
      -1);
}

}  // extern "C"
