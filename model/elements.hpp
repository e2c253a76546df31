#pragma once
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
