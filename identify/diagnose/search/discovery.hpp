#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "identify/diagnose/fit/fit.hpp"

namespace isorig::identify {

/// A sum of at most three products beside a model, with what speaks for each.
struct DiscoveredModel {
  model::ModelSpec spec;                    ///< fitted jointly
  std::map<std::string, double> inclusion;  ///< by the law's name: of each product that was screened
  std::vector<std::string_view> laws;       ///< that are in it
};

/// Laws for what `base` leaves (model::element::discovered()): every product of a state of the specimen with a factor,
/// with its time constant or its presliding on a grid, is a column s_i. Columns and residual are freed of what the
/// model's own columns and a small change of its time constants make of them. Every set S of at most three products,
/// each at one grid value, is weighed exactly (spike and slab: Mitchell & Beauchamp 1988) with the unit information
/// prior of Zellner (1986) on its coefficients,
///
///     ln BF(S) = (n - 1 - k)/2 ln(1 + n) - (n - 1)/2 ln(1 + n (1 - R_S^2)),   k = |S|
///
/// where R_S^2 is the share of the residual's squares that S explains and n the degrees of freedom that the residual of
/// the best set has (effective_dof.hpp), not the number of bins: neighbouring errors of a wrong law are one error.
/// A priori sizes 0 to 3 are alike, and so are the sets of one size. The inclusion probability of a product is the
/// weight of all sets that hold it.
///
/// The best set of each size is refitted with all numbers of the model free, `problem` weighing it. Smallest first;
/// empty where the nominal model has more weight than all of them.
[[nodiscard]] std::vector<DiscoveredModel> discover(const Problem& problem, const model::ModelSpec& base);

}  // namespace isorig::identify
