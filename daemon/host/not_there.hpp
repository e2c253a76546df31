#pragma once
#include <stdexcept>

namespace isorig::daemon {

/// What a call names does not exist: 404, and not 409, which says that the state forbids it and another time may do.
class NotThere : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace isorig::daemon
