#include "daemon/host/sample_server.hpp"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <chrono>
#include <deque>
#include <list>
#include <stdexcept>
#include <utility>

#include "daemon/host/unix_listener.hpp"
#include "daemon/recording/sample_stream.hpp"

namespace isorig::daemon {
namespace {

namespace net = boost::asio;
using Protocol = net::local::stream_protocol;
using boost::system::error_code;

constexpr auto kAcceptPause = std::chrono::milliseconds(100);

/// One turn's records, encoded, and how many there are of each kind.
struct Block {
  std::string bytes;
  samples::Lost count;
};

void add(samples::Lost& to, const samples::Lost& more) {
  to.frame += more.frame;
  to.pressure += more.pressure;
  to.control += more.control;
  to.events += more.events;
}

}  // namespace

struct SampleServer::Impl {
  Impl(const std::filesystem::path& path, unsigned mode, samples::Hello h, const Limits& l,
       std::function<bool(const Peer&)> see)
      : limits(l), hello(std::move(h)), may_see(std::move(see)), listener(path, mode), acceptor(io), pause(io) {
    const int own = ::dup(listener.fd());
    if (own < 0) throw std::runtime_error("no descriptor for the sample socket");
    acceptor.assign(Protocol(), own);
    acceptor.non_blocking(true);
  }

  void accept();
  void hand_out(const std::shared_ptr<const Block>& block, std::uint64_t lost_before);

  const Limits limits;
  const samples::Hello hello;
  const std::function<bool(const Peer&)> may_see;
  UnixListener listener;

  // Of the publisher's thread.
  std::shared_ptr<Block> filling = std::make_shared<Block>();
  samples::Lost not_handed_over;

  std::atomic<std::size_t> handed_over_bytes{0};
  std::atomic<std::size_t> open{0};

  // Of the thread in run().
  net::io_context io{1};
  Protocol::acceptor acceptor;
  net::steady_timer pause;
  std::list<std::weak_ptr<Subscriber>> subscribers;
};

/// One connection. Owned by the operations that are under way on it.
class SampleServer::Subscriber : public std::enable_shared_from_this<Subscriber> {
 public:
  Subscriber(Impl& server, Protocol::socket socket) : server_(server), socket_(std::move(socket)) { ++server_.open; }
  ~Subscriber() { --server_.open; }
  Subscriber(const Subscriber&) = delete;
  Subscriber& operator=(const Subscriber&) = delete;

  void begin(const samples::Hello& hello) {
    auto block = std::make_shared<Block>();
    samples::append(block->bytes, hello);
    push(std::move(block));
    listen();
  }

  void offer(const std::shared_ptr<const Block>& block, std::uint64_t lost_before) {
    if (closed_) return;
    if (queued_bytes_ + block->bytes.size() > server_.limits.queue_bytes) return add(lost_, block->count);
    lost_.before_the_socket = lost_before;
    if (!(lost_ == told_)) {
      auto note = std::make_shared<Block>();
      samples::append(note->bytes, lost_);
      told_ = lost_;
      push(std::move(note));
    }
    push(block);
  }

 private:
  void push(std::shared_ptr<const Block> block) {
    queued_bytes_ += block->bytes.size();
    queue_.push_back(std::move(block));
    if (queue_.size() == 1) write();
  }

  void write() {
    net::async_write(socket_, net::buffer(queue_.front()->bytes),
                     [self = shared_from_this()](error_code error, std::size_t) {
                       if (error) return self->close();
                       self->queued_bytes_ -= self->queue_.front()->bytes.size();
                       self->queue_.pop_front();
                       if (!self->queue_.empty()) self->write();
                     });
  }

  /// The only way to see that a subscriber has gone while its queue is empty.
  void listen() {
    socket_.async_read_some(net::buffer(ignored_), [self = shared_from_this()](error_code error, std::size_t) {
      if (error) return self->close();
      self->listen();
    });
  }

  void close() {
    closed_ = true;
    error_code ignored;
    socket_.close(ignored);
  }

  Impl& server_;
  Protocol::socket socket_;
  std::deque<std::shared_ptr<const Block>> queue_;  // the front one is being written
  std::size_t queued_bytes_ = 0;
  samples::Lost lost_, told_;
  bool closed_ = false;
  std::array<char, 256> ignored_{};
};

void SampleServer::Impl::accept() {
  acceptor.async_accept([this](error_code error, Protocol::socket socket) {
    if (error == net::error::operation_aborted) return;
    if (error) {  // no descriptor left: tried again, since one may be given back
      pause.expires_after(kAcceptPause);
      pause.async_wait([this](error_code stopped) {
        if (!stopped) accept();
      });
      return;
    }
    if (open < limits.subscribers && (!may_see || may_see(peer_of(socket.native_handle())))) {
      const auto subscriber = std::make_shared<Subscriber>(*this, std::move(socket));
      subscribers.push_back(subscriber);
      subscriber->begin(hello);
    }
    accept();
  });
}

void SampleServer::Impl::hand_out(const std::shared_ptr<const Block>& block, std::uint64_t lost_before) {
  handed_over_bytes -= block->bytes.size();
  for (auto s = subscribers.begin(); s != subscribers.end();) {
    if (const auto subscriber = s->lock()) {
      subscriber->offer(block, lost_before);
      ++s;
    } else {
      s = subscribers.erase(s);
    }
  }
}

SampleServer::SampleServer(const std::filesystem::path& socket_path, unsigned mode, std::string rig,
                           std::int64_t epoch_unix_us, const Limits& limits, std::function<bool(const Peer&)> may_see)
    : impl_(std::make_unique<Impl>(socket_path, mode, samples::Hello{samples::kVersion, epoch_unix_us, std::move(rig)},
                                   limits, std::move(may_see))) {}

SampleServer::~SampleServer() = default;

void SampleServer::run() {
  impl_->accept();
  for (;;) {
    try {
      impl_->io.run();
      return;
    } catch (const std::exception& e) {  // no memory for a block: the next ones are tried all the same
      spdlog::error("samples: {}", e.what());
    }
  }
}

void SampleServer::stop() {
  impl_->io.stop();
}

void SampleServer::unlink() noexcept {
  impl_->listener.unlink();
}

void SampleServer::on_event(const EventRecord& record) {
  samples::append(impl_->filling->bytes, record);
  ++impl_->filling->count.events;
}
void SampleServer::on_frame(const FrameRecord& record) {
  samples::append(impl_->filling->bytes, record);
  ++impl_->filling->count.frame;
}
void SampleServer::on_pressure(const PressureRecord& record) {
  samples::append(impl_->filling->bytes, record);
  ++impl_->filling->count.pressure;
}
void SampleServer::on_control(const ControlRecord& record) {
  samples::append(impl_->filling->bytes, record);
  ++impl_->filling->count.control;
}

void SampleServer::end_of_turn(std::size_t dropped, std::int64_t) {
  auto& m = *impl_;
  if (m.filling->bytes.empty()) return;
  const auto size = m.filling->bytes.size();
  if (m.open == 0) {
    m.filling->bytes.clear();
    m.filling->count = {};
    return;
  }
  if (m.handed_over_bytes + size > m.limits.handed_over_bytes) {  // the thread in run() gets no processor
    add(m.not_handed_over, m.filling->count);
    m.filling->bytes.clear();
    m.filling->count = {};
    return;
  }
  m.handed_over_bytes += size;
  const auto lost_before = dropped + m.not_handed_over.frame + m.not_handed_over.pressure + m.not_handed_over.control +
                           m.not_handed_over.events;
  net::post(m.io, [&m, block = std::shared_ptr<const Block>(std::move(m.filling)), lost_before] {
    m.hand_out(block, lost_before);
  });
  m.filling = std::make_shared<Block>();
  m.filling->bytes.reserve(size);
}

}  // namespace isorig::daemon
