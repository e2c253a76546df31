#pragma once
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"
#include "identify/diagnose/search/resolution.hpp"

namespace isorig::identify {

/// Nominal model plus a set of effects, fitted.
struct Hypothesis {
  std::vector<const model::Physics*> effects;  ///< sorted by catalogue order; empty: the nominal model
  std::string empirical;                       ///< variables of the tables in it, "" without any
  Fit fit;                                     ///< under the noise that it was left with itself
  double ls_chi2 = 0.0;                        ///< sum of squares over the instrument's own noise: what it leaves
  model::ModelSpec ls_spec;                    ///< the numbers that leave it: where a larger model's search begins
  bool plain_numbers = false;                  ///< the fit under its noise is far from least squares (parsimony.cpp)
  double evidence = 0.0;                       ///< log-likelihood minus half log(rows) per free number
  std::optional<std::size_t> nominal_arms;     ///< of the nominal model that it was grown from

  [[nodiscard]] bool has(const model::Physics& effect) const;
  [[nodiscard]] std::string key() const;  ///< "coulomb_friction+zero_drift"; "nominal"
};

/// A law that takes the place of an arm (LawTraits::replaces_arm) beside a further arm that is linear: with no more
/// linear arms than the nominal model has, none is missing. The further one becomes an arm of the model, its effect
/// goes, and what is missing stands beside the arms. In seeds 20261147 to 20261151 of the proof a second relaxation was
/// named three times beside an arm that is not linear, and never was there.
void count_arms(Hypothesis& hypothesis);

/// In the order of the catalogue, as Hypothesis::effects are.
void sort_as_in_catalogue(std::vector<const model::Physics*>& effects);

/// A model can have this effect, `base` lacks it, and the recordings can show it.
[[nodiscard]] bool may_be_tried(const model::Physics& effect, const Hypothesis& base, std::span<const Series> series);

/// The law's part with its k-th starts; a parameter with fewer keeps its last.
[[nodiscard]] model::Part started_part(const model::Physics& effect, const model::Law& law, std::size_t k,
                                       const model::Reference& recording);

class Search {
 public:
  /// `instrument`: the force channel's own noise, as its rests show it. `withheld`: effects that it does not try, so
  /// that a recording can be simulated whose physics the catalogue lacks (reliability/).
  Search(std::span<const Series> series, const NoiseModel& instrument, unsigned threads,
         std::vector<const model::Physics*> withheld = {});

  [[nodiscard]] bool withholds(const model::Physics& effect) const;
  /// The same search with another noise of the force channel and one more effect withheld.
  [[nodiscard]] Search under(const NoiseModel& noise, const model::Physics& also_withheld) const;

  /// Nominal model from many starts of its time constants.
  [[nodiscard]] Hypothesis nominal(const model::ModelSpec& nominal) const;

  /// Every effect of the catalogue added to `base`, each with its best law; refitted jointly with all the
  /// rest. `thorough`: every effect gets a full fit; else only the `keep` most promising.
  [[nodiscard]] std::vector<Hypothesis> extend(const Hypothesis& base, std::size_t keep, bool thorough) const;

  /// One effect with one law from given starts.
  [[nodiscard]] Fit fit_from(const model::ModelSpec& spec, int iterations) const;

  /// New starts for the time constants of the nominal arms with everything else kept; then noise and a last
  /// fit.
  void settle(Hypothesis& hypothesis, bool restart_arms) const;

  /// The same effects, each with the law that has the best evidence beside the others' present ones: a law was chosen
  /// before the effects that came later were there.
  [[nodiscard]] Hypothesis with_other_laws(const Hypothesis& chosen) const;

  /// The same effects without numbers at the end of their ranges (at_wrong_bound), with which no model is handed out:
  /// an effect that has one gets another of its laws, a slip loses the events that have one. What is left may be
  /// `law_leaves_ratio` times the squares; else the effect keeps what it has. Nothing when all of them do.
  [[nodiscard]] std::optional<Hypothesis> inside_ranges(const Hypothesis& chosen) const;

  /// The same explanation with one effect left out, refitted.
  [[nodiscard]] Hypothesis without(const Hypothesis& whole, const model::Physics& effect) const;

  [[nodiscard]] const Problem& instrument_problem() const noexcept { return instrument_problem_; }
  [[nodiscard]] const NoiseModel& instrument() const noexcept { return instrument_problem_.noise(); }

 private:
  struct Trial {
    const model::Physics* effect = nullptr;
    const model::Law* law = nullptr;
    model::ModelSpec spec;
    Fit fit;
    bool promising = false;  ///< its effect is one of those that leave least
  };
  [[nodiscard]] std::vector<Trial> trials(const Hypothesis& base) const;
  /// `chosen` with each of the `tried` best other laws of an effect that is no event.
  [[nodiscard]] std::vector<Hypothesis> other_laws(const Hypothesis& chosen, const model::Physics& effect,
                                                   std::size_t tried) const;
  /// A law from each of its starts, added to `spec`.
  static void add_started(const model::Physics& effect, const model::Law& law, const model::ModelSpec& spec,
                          const model::Reference& recording, std::vector<Trial>& out);
  /// Two steps from every start, two more from the better half of each effect's; the best first, to go all the way.
  void screen(std::vector<Trial>& trials, const model::ModelSpec& base) const;
  /// Where starts of models that contain `base` are compared: in merged bins where `base` leaves no more of them than
  /// of the bins themselves, in those else (motion that bends within a merged bin, a hum whose phase it loses).
  [[nodiscard]] const Problem& to_compare(const model::ModelSpec& base) const;
  static void keep_better_half(std::vector<Trial>& trials);
  static void drop_repeated(std::vector<Trial>& fitted);
  /// Beside the trial of another effect the event is hopeless (explained_without). A law that describes one recording
  /// alone, such as a zero that wanders, does not count: it follows several slips, too, so that it would hide the slips
  /// that are there.
  [[nodiscard]] static bool explained_beside(const Trial& event, std::span<const Trial> trials, double leaves_ratio);
  /// To the best trial with an event, unless another effect explains the recording without (`law_leaves_ratio`).
  void add_further_events(std::vector<Trial>& trials, const InstrumentResolution& resolution) const;
  void add_events(const model::Physics& effect, const model::Law& law, const Hypothesis& base,
                  std::vector<Trial>& out) const;

  /// The recordings in fewer bins.
  struct Coarse {
    std::vector<Series> series;
    Problem problem;
  };
  [[nodiscard]] static std::shared_ptr<const Coarse> coarse(std::span<const Series> series, const NoiseModel& noise);

  std::span<const Series> series_;
  Problem instrument_problem_;
  std::shared_ptr<const Coarse> coarse_;  ///< none where the bins are few already
  unsigned threads_;
  std::vector<const model::Physics*> withheld_;
};

}  // namespace isorig::identify
