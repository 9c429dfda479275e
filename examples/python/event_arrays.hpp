#pragma once
// Events in NumPy arrays: read where they lie if their layout is that of `Event`, converted block by block if not.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <evmarker/events/event.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

namespace python {

namespace py = pybind11;

inline constexpr std::size_t kBlockEvents = 256;

/// A column of whole numbers of any integer type, wherever they lie in memory.
class IntegerColumn {
 public:
  /// @param numbers must outlive the column
  /// @param name in errors
  /// @throws std::invalid_argument for another type, or another number of dimensions
  IntegerColumn(const py::array& numbers, const std::string& name)
      : first_(static_cast<const std::byte*>(numbers.data())), read_(reader_of(numbers)) {
    if (read_ == nullptr)
      throw std::invalid_argument("events: " + name + " is of type " + py::str(numbers.dtype()).cast<std::string>() +
                                  ", must be of an integer type in the byte order of this machine");
    if (numbers.ndim() != 1)
      throw std::invalid_argument("events: " + name + " has " + std::to_string(numbers.ndim()) +
                                  " dimensions, must have 1");
    size_ = static_cast<std::size_t>(numbers.shape(0));
    stride_ = numbers.strides(0);
  }

  std::size_t size() const { return size_; }
  /// Reads as many numbers as there is room for, which must be there, from number `begin` on.
  void read(std::size_t begin, std::span<std::int64_t> numbers) const {
    read_(first_ + stride_ * static_cast<std::ptrdiff_t>(begin), stride_, numbers);
  }

 private:
  using Read = void (*)(const std::byte* first, std::ptrdiff_t stride, std::span<std::int64_t> numbers);

  template <typename Number>
  static void read_as(const std::byte* at, std::ptrdiff_t stride, std::span<std::int64_t> numbers) {
    for (std::int64_t& number : numbers) {
      Number value;
      std::memcpy(&value, at, sizeof value);  // may be at any address
      number = static_cast<std::int64_t>(value);
      at += stride;
    }
  }

  template <typename... Numbers>
  static Read reader_among(const py::array& numbers) {
    Read read = nullptr;
    ((py::isinstance<py::array_t<Numbers>>(numbers) ? void(read = read_as<Numbers>) : void()), ...);
    return read;
  }

  static Read reader_of(const py::array& numbers) {
    if (py::isinstance<py::array_t<bool>>(numbers)) return read_as<std::uint8_t>;
    return reader_among<std::int8_t, std::uint8_t, std::int16_t, std::uint16_t, std::int32_t, std::uint32_t,
                        std::int64_t, std::uint64_t>(numbers);
  }

  const std::byte* first_;
  Read read_;
  std::size_t size_ = 0;
  std::ptrdiff_t stride_ = 0;
};

/// Four columns of one length.
class EventColumns {
 public:
  /// @throws std::invalid_argument naming the column that is no such one
  EventColumns(const py::array& x, const py::array& y, const py::array& t, const py::array& p)
      : x_(x, "x"), y_(y, "y"), t_(t, "t"), p_(p, "p") {
    for (const auto& [name, column] : {std::pair("y", &y_), {"t", &t_}, {"p", &p_}})
      if (column->size() != x_.size())
        throw std::invalid_argument("events: " + std::string(name) + " has " + std::to_string(column->size()) +
                                    " numbers, x has " + std::to_string(x_.size()));
  }

  /// Calls `use` with the events in blocks, in order.
  template <typename Use>
  void for_each_block(const Use& use) const {
    std::array<std::int64_t, kBlockEvents> x, y, t, p;
    std::array<evmarker::Event, kBlockEvents> block;
    for (std::size_t begin = 0; begin < x_.size(); begin += kBlockEvents) {
      const std::size_t count = std::min(kBlockEvents, x_.size() - begin);
      for (const auto& [column, numbers] : {std::pair(&x_, &x), {&y_, &y}, {&t_, &t}, {&p_, &p}})
        column->read(begin, std::span(*numbers).first(count));
      for (std::size_t i = 0; i < count; ++i)
        block[i] = {coordinate(x[i]), coordinate(y[i]), static_cast<std::int16_t>(p[i] > 0), t[i]};
      use(std::span<const evmarker::Event>(block).first(count));
    }
  }

 private:
  // One that 16 bits cannot hold becomes 65535, as in `to_event`: trackers count it as off the sensor.
  static std::uint16_t coordinate(std::int64_t number) {
    return static_cast<std::uint16_t>(number < 0 || number > 0xFFFF ? 0xFFFF : number);
  }

  IntegerColumn x_, y_, t_, p_;
};

/// @throws py::type_error for any other object
inline py::array require_array(const py::object& events) {
  if (py::isinstance<py::array>(events)) return events.cast<py::array>();
  throw py::type_error("events: " + py::str(py::type::of(events).attr("__name__")).cast<std::string>() +
                       " is no NumPy array; there must be one with the fields x, y, t and p");
}

/// The field of a structured array that has one of two names.
/// @throws std::invalid_argument where it has none
inline py::array field(const py::array& events, const char* name, const char* other_name) {
  const py::object fields = events.dtype().attr("fields");
  for (const char* known : {name, other_name})
    if (!fields.is_none() && fields.contains(known)) return py::array(events[known]);
  throw std::invalid_argument("events: an array of type " + py::str(events.dtype()).cast<std::string>() +
                              " has no field " + name + "; there must be x, y, t and p");
}

/// Events in a structured array with the fields x, y, t (or timestamp) and p (or polarity).
class EventArray {
 public:
  /// @param events must outlive this
  /// @throws std::invalid_argument naming the field that is missing or of another type
  explicit EventArray(const py::array& events) {
    const bool of_events = py::isinstance<py::array_t<evmarker::Event>>(events) && events.ndim() == 1;
    const bool dense = of_events && (events.strides(0) == sizeof(evmarker::Event) || events.shape(0) < 2);
    if (dense && reinterpret_cast<std::uintptr_t>(events.data()) % alignof(evmarker::Event) == 0) {
      in_place_ =
          std::span(static_cast<const evmarker::Event*>(events.data()), static_cast<std::size_t>(events.size()));
    } else {
      const py::array x = field(events, "x", "x"), y = field(events, "y", "y"), t = field(events, "t", "timestamp"),
                      p = field(events, "p", "polarity");
      columns_.emplace(x, y, t, p);
    }
  }

  template <typename Use>
  void for_each_block(const Use& use) const {
    if (columns_)
      columns_->for_each_block(use);
    else
      use(in_place_);
  }

 private:
  std::span<const evmarker::Event> in_place_;
  std::optional<EventColumns> columns_;
};

}  // namespace python
