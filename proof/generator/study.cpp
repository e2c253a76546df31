#include "proof/generator/study.hpp"

#include <nlohmann/json.hpp>

#include "base/parallel.hpp"
#include "messages/csv.hpp"
#include "proof/foreign_laws/case.hpp"
#include "proof/sealed.hpp"

namespace isorig::proof {
namespace {

using OrderedJson = nlohmann::ordered_json;

std::string truth_text(const MadeRecording& made) {
  const messages::CsvColumnView columns[] = {{"t_s", made.recording.frame.t_s}, {"force_N", made.truth_N}};
  return messages::number_csv_text(columns);
}

OrderedJson label_of(const Case& c) {
  OrderedJson label;
  label["category"] = name_of(c.plan.category);
  label["nominal"] = c.nominal;
  label["trap"] = name_of(c.plan.trap);
  label["effects"] = OrderedJson::array();
  for (const ConcealedEffect& effect : c.effects) {
    OrderedJson one{{"effect", effect.name},
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
  return label;
}

struct MadeCase {
  std::string name;
  std::string nominal;
  MadeRecording train;
  MadeRecording heldout;
  OrderedJson label;
};

MadeCase make_case(const StudyOptions& options, std::size_t number, const CasePlan& plan) {
  const auto made = [&](const auto& drawn) {
    return MadeCase{drawn.name, drawn.nominal, record(drawn, Part::kTrain, options.seed),
                    record(drawn, Part::kHeldout, options.seed), label_of(drawn)};
  };
  return options.laws == Laws::kForeign ? made(foreign::draw_case(options.seed, number, plan))
                                        : made(draw_case(options.seed, number, plan));
}

}  // namespace

std::string_view name_of(Laws laws) {
  return laws == Laws::kForeign ? "foreign" : "catalogue";
}

std::string generate_study(const StudyOptions& options) {
  const std::vector<CasePlan> plans = options.laws == Laws::kForeign ? foreign::plan_study(options.seed, options.cases)
                                                                     : plan_study(options.seed, options.cases);
  std::vector<OrderedJson> labels(plans.size());
  std::vector<OrderedJson> listed(plans.size());
  base::parallel_for(plans.size(), options.threads, [&](std::size_t i) {
    MadeCase made = make_case(options, i, plans[i]);
    messages::write_recording(options.out / made.name / "train", made.train.recording);
    messages::write_recording(options.out / made.name / "heldout", made.heldout.recording);
    const std::string truth = truth_text(made.heldout);
    write_text(options.out / "sealed" / "truth" / (made.name + ".csv"), truth);
    labels[i] = std::move(made.label);
    labels[i]["truth_sha256"] = sha256(truth);
    labels[i]["case"] = made.name;
    listed[i] = {{"case", made.name}, {"nominal", made.nominal}};
  });
  const OrderedJson cases{{"format", "isorig-proof-cases/1"}, {"cases", listed}};
  write_text(options.out / "cases.json", cases.dump(2) + "\n");
  OrderedJson sealed{{"format", "isorig-proof-labels/1"}, {"seed", options.seed}};
  if (options.laws != Laws::kCatalogue) sealed["laws"] = name_of(options.laws);
  sealed["cases"] = labels;
  const std::string text = sealed.dump(2) + "\n";
  seal(options.out / "sealed" / "labels.json", options.out / "labels.sha256", text);
  return sha256(text);
}

}  // namespace isorig::proof
