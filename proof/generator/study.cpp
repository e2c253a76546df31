#include "proof/generator/study.hpp"

#include <nlohmann/json.hpp>

#include "base/parallel.hpp"
#include "messages/csv.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

using Json = nlohmann::ordered_json;

std::string truth_text(const MadeRecording& made) {
  const messages::CsvColumnView columns[] = {{"t_s", made.recording.frame.t_s}, {"force_N", made.truth_N}};
  return messages::number_csv_text(columns);
}

Json label_of(const Case& c, const std::string& truth_hash) {
  Json label;
  label["category"] = name_of(c.plan.category);
  label["nominal"] = c.nominal;
  label["trap"] = name_of(c.plan.trap);
  label["effects"] = Json::array();
  for (const ConcealedEffect& effect : c.effects) {
    Json one{{"effect", effect.name},
             {"size", effect.size},
             {"strength", effect.strength},
             {"strength_is", effect_kind(effect.name).strength}};
    one["shape"] = effect.shape;
    label["effects"].push_back(std::move(one));
  }
  label["noise_N"] = c.instruments.force_noise_N;
  label["coloured_noise_N"] = c.instruments.coloured_noise_N;
  label["residual_over_noise"] = c.residual_over_noise;
  label["background_over_noise"] = c.background_over_noise;
  const Specimen& s = c.rig.specimen;
  label["stiffness_N_mm"] = s.stiffness_N_mm;
  for (const Arm& arm : s.arms)
    label["arms"].push_back({{"stiffness_N_mm", arm.stiffness_N_mm}, {"time_constant_s", arm.time_constant_s}});
  label["truth_sha256"] = truth_hash;
  return label;
}

}  // namespace

std::string generate_study(const StudyOptions& options) {
  const std::vector<CasePlan> plans = plan_study(options.seed, options.cases);
  std::vector<Json> labels(plans.size());
  std::vector<Json> listed(plans.size());
  base::parallel_for(plans.size(), options.threads, [&](std::size_t i) {
    const Case c = draw_case(options.seed, i, plans[i]);
    const MadeRecording train = record(c, Part::kTrain, options.seed);
    const MadeRecording heldout = record(c, Part::kHeldout, options.seed);
    messages::write_recording(options.out / c.name / "train", train.recording);
    messages::write_recording(options.out / c.name / "heldout", heldout.recording);
    const std::string truth = truth_text(heldout);
    write_text(options.out / "sealed" / "truth" / (c.name + ".csv"), truth);
    labels[i] = label_of(c, sha256(truth));
    labels[i]["case"] = c.name;
    listed[i] = {{"case", c.name}, {"nominal", c.nominal}};
  });
  const Json cases{{"format", "isorig-proof-cases/1"}, {"cases", listed}};
  write_text(options.out / "cases.json", cases.dump(2) + "\n");
  const Json sealed{{"format", "isorig-proof-labels/1"}, {"seed", options.seed}, {"cases", labels}};
  const std::string text = sealed.dump(2) + "\n";
  seal(options.out / "sealed" / "labels.json", options.out / "labels.sha256", text);
  return sha256(text);
}

}  // namespace isorig::proof
