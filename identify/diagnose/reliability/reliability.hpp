#pragma once
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "identify/diagnose/diagnosis.hpp"

namespace isorig::identify {

struct ReliabilityOptions {
  std::size_t rehearsals = 48;
  unsigned threads = 2;
  /// The first ones, if they were made before (of the same study): they are not simulated again.
  std::vector<Rehearsal> known{};
  /// Called with the part of them that is done; from any thread, one at a time.
  std::function<void(double fraction)> on_progress{};
};

/// Simulation-based calibration (Talts et al. 2018; Modrak et al. 2023) of the names that `study` gives, from the
/// predictive distribution of its own explanations (replicate.hpp), with their own numbers, noise and discrepancy:
///
///   - The truths are the most probable explanations and the nominal model, in turn, each as often as the others.
///     Weights are what is to be checked, so that they do not choose: a rival that they rule out is simulated as often
///     as the explanation that won.
///   - Of withheld_share of the recordings, the search is not given one of the effects: it meets physics outside of
///     its catalogue, and what it then names for that effect is wrong.
///   - Every name that comes out is a claim; Sureness says by how much weights overstate. Recordings
///     with an effect withheld count so much that they are outside_catalogue_share of all.
///
/// Physics whose law none of the explanations has is not simulated: the result holds for recordings that resemble one
/// of them. A replicate that cannot be diagnosed says why and counts nothing. The same study gives the same result,
/// whatever the number of threads. `originals`, `names` and `given` are what diagnose() was called with to make it.
[[nodiscard]] Reliability measure_reliability(const Study& study, std::span<const messages::Recording> originals,
                                              std::span<const std::string> names, const model::ModelSpec& given,
                                              const ReliabilityOptions& options);

/// States the probabilities of the names by `reliability`, and keeps it in the diagnosis. Where too few claims were
/// made the shipped numbers stay.
void restate(Diagnosis& diagnosis, Reliability reliability);

/// What came of it, in one sentence each; for people.
[[nodiscard]] std::vector<std::string> reliability_text(const Reliability& reliability);

}  // namespace isorig::identify
