#include "evmarker/io/block_reader.hpp"

#include <doctest/doctest.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <thread>

#include "evmarker/io/line_reader.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

std::string text(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace

TEST_CASE("BlockReader: blocks in order, preceded by what is kept, at the end only that") {
  const TemporaryFolder folder;
  BlockReader reader(write_file(folder / "a", "abcdefghij"), 4);
  CHECK(reader.bytes_total() == 10);
  CHECK(text(reader.next()) == "abcd");
  CHECK(text(reader.next(2)) == "cdefgh");
  CHECK(text(reader.next(5)) == "defghij");
  CHECK_FALSE(reader.at_end());
  CHECK(text(reader.next(1)) == "j");
  CHECK(reader.at_end());
  CHECK(reader.next().empty());
  CHECK(reader.at_end());
}

TEST_CASE("BlockReader: any block size yields the file") {
  const TemporaryFolder folder;
  std::string content;
  for (int i = 0; i < 3000; ++i) content += static_cast<char>(i * 7);
  const auto path = write_file(folder / "a", content);
  for (const std::size_t size : {1U, 7U, 1000U, 2999U, 3000U, 3001U, 100000U}) {
    BlockReader reader(path, size);
    std::string read;
    for (auto block = reader.next(); !block.empty(); block = reader.next()) read += text(block);
    CHECK(read == content);
  }
}

TEST_CASE("BlockReader: missing files and folders") {
  const TemporaryFolder folder;
  CHECK(contains(error_of([&] { BlockReader(folder / "none"); }), "none: cannot open: No such file"));
  CHECK(contains(error_of([&] { BlockReader(folder / "."); }), "is a directory"));
  BlockReader empty(write_file(folder / "empty", ""));
  CHECK(empty.next().empty());
  CHECK(empty.at_end());
}

TEST_CASE("BlockReader: a FIFO to which nobody writes is left when it is told to, and read when somebody does") {
  const TemporaryFolder folder;
  const auto path = folder / "fifo";
  REQUIRE(::mkfifo(path.c_str(), 0600) == 0);
  std::atomic<bool> stop = false;
  std::thread stopping([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    stop = true;
  });
  CHECK(BlockReader(path, 4, &stop).next().empty());
  stopping.join();
  std::thread writer([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    std::ofstream(path) << "abcdef";
  });
  BlockReader reader(path, 4);
  CHECK(text(reader.next()) == "abcd");
  CHECK(text(reader.next()) == "ef");
  CHECK(reader.next().empty());
  writer.join();
}

TEST_CASE("BlockReader: a failure is told as often as it is asked") {
  if (!std::filesystem::exists("/proc/self/mem")) {  // whose first page is nowhere
    MESSAGE("skipped: there is no /proc/self/mem");
    return;
  }
  BlockReader reader("/proc/self/mem");
  for (int i = 0; i < 3; ++i) CHECK(contains(error_of([&] { reader.next(); }), "cannot read: Input/output error"));
}

TEST_CASE("LineReader: lines across blocks, with numbers, offsets and a missing end") {
  const TemporaryFolder folder;
  LineReader lines(write_file(folder / "a", "first\r\n\nthird line\nlast"), 4);
  CHECK(lines.next() == "first");
  CHECK(lines.next() == "");
  CHECK(lines.next() == "third line");
  CHECK(lines.line_number() == 3);
  CHECK(lines.byte_offset() == 8);
  CHECK(lines.line_ended());
  CHECK(lines.next() == "last");
  CHECK_FALSE(lines.line_ended());
  CHECK(lines.bytes_read() == 23);
  CHECK(lines.next() == std::nullopt);
  CHECK(lines.next() == std::nullopt);
}
