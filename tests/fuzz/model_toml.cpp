// model.toml: read, written, read again, and run over a second of motion.
#include <stdexcept>
#include <vector>

#include "model/composed.hpp"
#include "target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isorig;
  try {
    const auto spec = model::parse_model(fuzz::text({data, size}), "model.toml");
    const auto written = model::model_text(spec);
    const auto again = model::parse_model(written, "again.toml");
    fuzz::require(model::model_text(again) == written, "a model is another one when it is read back");
    try {
      model::RunningModel running(spec, {5.0, 10.0, 1.0, 1.0, 30.0});
      model::Instant now;
      running.reset(now);
      for (int i = 1; i <= 100; ++i) {
        now.dt_s = 0.01;
        now.t_s += now.dt_s;
        now.step_mm = i < 50 ? 0.02 : -0.02;
        now.position_mm += now.step_mm;
        now.elongation_mm = now.position_mm + 5.0;
        now.velocity_mm_s = now.step_mm / now.dt_s;
        (void)running.step(now);
      }
    } catch (const std::invalid_argument& error) {
      fuzz::refused(error.what());
    }
  } catch (const base::ConfigError& error) {
    fuzz::refused(error);
  }
  return 0;
}
