#pragma once
#include <cstddef>
#include <memory>

#include "model/process.hpp"

/// The elements a nominal model is composed of.
namespace isorig::model::element {

const Physics& spring();
const Physics& maxwell();
/// The force that a Maxwell arm holds when a recording's rows begin. Its time constant is the arm's, see
/// follow_arms().
const Physics& arm_start();
const Physics& dashpot();
const Physics& mass();
const Physics& constant();
/// What the constant is larger by in one of several recordings: every session takes its own tare.
const Physics& force_zero();
/// Its part in a recording that is none of the `recordings` of the fit. Whoever tares by the same habit makes zeros
/// that scatter about one mean, and the mean of those seen is the best guess of the next: its error has the variance (1
/// + 1/n) of the scatter's, and that of any one of them has 2.
std::unique_ptr<Process> force_zero_elsewhere(std::size_t recordings);
const Physics& gravity();

/// What was measured and has no law yet: tables of one variable, in force or in motion.
const Physics& empirical_force();
const Physics& empirical_motion();
/// The same with memory, in few numbers: of the specimen and of the force channel.
const Physics& empirical_memory();
const Physics& empirical_response();
/// A law without a name, as a product (identify/diagnose/search/discovery.hpp). Its laws are called CARRIER_FACTOR:
/// "arm_position" pulls with c z x. Carriers are elastic, arm, dashpot and friction.
const Physics& discovered();

}  // namespace isorig::model::element
