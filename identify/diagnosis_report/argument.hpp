#pragma once
#include <vector>

#include "identify/diagnosis_report/simulated_force.hpp"
#include "identify/report/page.hpp"

/// The sections of a diagnosis' page, in its order (docs/reports.md).
namespace isorig::identify {

struct Argument {
  const Study& study;
  std::vector<SimulatedForce> forces;  ///< one a recording
  Stretch stretch;                     ///< the one to look at closely
};

/// Where model and muscle part: measured force over both models, the residual under it, in one stretch.
void add_parting(report::Page& page, const Argument& a);
/// What was left out: in words, as an equation, as a shape with its band, with its numbers and what speaks against
/// them.
void add_missing(report::Page& page, const Argument& a);
/// Residual before and after with the noise as a band, and force over position.
void add_residuals(report::Page& page, const Argument& a);
/// What was left out of the fit and predicted, and how the numbers of the nominal model moved.
void add_predictions(report::Page& page, const Argument& a);
/// What each rival leaves, what cannot be told, what to run next.
void add_rivals(report::Page& page, const Argument& a);
/// How often names were right on recordings simulated from these explanations, where that was asked for.
void add_reliability(report::Page& page, const Argument& a);
/// Where the nominal model misses, by variables and stretches; faults of the data; the noise.
void add_evidence(report::Page& page, const Argument& a);

}  // namespace isorig::identify
