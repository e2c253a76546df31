#pragma once
#include "identify/diagnose/study.hpp"

namespace isorig::identify {

/// Before the motion turns round for the first time, nothing tells a slip from the state that friction, play or
/// softening began in: a first stroke is another one than the next either way. Beside such an effect an event of which
/// all happens there stays in the model, as that state, and its name is no surer than one whose law is refused
/// (stated_if_refused). A note says so. (A specimen whose friction was hysteresis of another form got a slip with 0.97
/// at the very moment at which the motion began.)
void doubt_events_of_the_first_stroke(const Study& study, Diagnosis& out);

}  // namespace isorig::identify
