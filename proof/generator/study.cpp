#include "proof/generator/study.hpp"

#include <atomic>
#include <nlohmann/json.hpp>

#include "base/parallel.hpp"
#include "cli/screen/progress.hpp"
#include "messages/csv.hpp"
#include "proof/foreign_laws/case.hpp"
#include "proof/generator/unfinished.hpp"
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

/// Of `of` cases one more has ended, however it did.
struct Counted {
  cli::Progress& progress;
  std::atomic<std::size_t>& ended;
  std::size_t of;
  ~Counted() {
    const std::size_t now = ++ended;
    progress.at(static_cast<double>(now) / static_cast<double>(of), std::to_string(now) + " of " + std::to_string(of));
  }
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
  std::filesystem::remove(options.out / "cases.json");  // a study that is half another one is none to be run
  const Unfinished unfinished(options);
  std::vector<OrderedJson> labels(plans.size());
  cli::Progress progress("generate");
  std::atomic<std::size_t> ended = 0;
  base::parallel_for(plans.size(), options.threads, [&](std::size_t i) {
    const Counted counted{progress, ended, plans.size()};
    if (auto kept = unfinished.kept(i)) {
      labels[i] = std::move(*kept);
      return;
    }
    MadeCase made = make_case(options, i, plans[i]);
    messages::write_recording(options.out / made.name / "train", made.train.recording);
    messages::write_recording(options.out / made.name / "heldout", made.heldout.recording);
    const std::string truth = truth_text(made.heldout);
    write_text(options.out / "sealed" / "truth" / (made.name + ".csv"), truth);
    labels[i] = std::move(made.label);
    labels[i]["truth_sha256"] = sha256(truth);
    labels[i]["case"] = made.name;
    unfinished.keep(i, labels[i]);
  });
  OrderedJson cases{{"format", "isorig-proof-cases/1"}, {"cases", OrderedJson::array()}};
  for (const OrderedJson& label : labels)
    cases["cases"].push_back({{"case", label.at("case")}, {"nominal", label.at("nominal")}});
  write_text(options.out / "cases.json", cases.dump(2) + "\n");
  OrderedJson sealed{{"format", "isorig-proof-labels/1"}, {"seed", options.seed}};
  if (options.laws != Laws::kCatalogue) sealed["laws"] = name_of(options.laws);
  sealed["cases"] = labels;
  const std::string text = sealed.dump(2) + "\n";
  seal(options.out / "sealed" / "labels.json", options.out / "labels.sha256", text);
  unfinished.finish();
  return sha256(text);
}

}  // namespace isorig::proof
