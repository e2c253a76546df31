#pragma once
#include "model/process.hpp"

/// The elements a nominal model is composed of.
namespace isorig::model::element {

const Physics& spring();
const Physics& maxwell();
const Physics& dashpot();
const Physics& mass();
const Physics& constant();
const Physics& gravity();

}  // namespace isorig::model::element
