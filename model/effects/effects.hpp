#pragma once
#include "model/process.hpp"

/// One function per file of this folder. Add yours to list.inc (docs/effects.md).
namespace isorig::model::effect {

#define ISORIG_EFFECT(name) const Physics& name();
#include "model/effects/list.inc"
#undef ISORIG_EFFECT

}  // namespace isorig::model::effect
