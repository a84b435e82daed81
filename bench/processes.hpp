#pragma once
// Studies whose scenes are judged in processes: limits of their time, and what they write.

#include <nlohmann/json.hpp>

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <ctime>
#include <stdexcept>
#include <string>
#include <vector>

namespace bromwich {

inline double cpu_seconds() { return double(std::clock()) / CLOCKS_PER_SEC; }

/// Ends this process by SIGXCPU after so many seconds more of its CPU time.
inline void limit_cpu(double seconds) {
  rlimit most;
  getrlimit(RLIMIT_CPU, &most);
  most.rlim_cur = std::min(most.rlim_max, rlim_t(cpu_seconds() + seconds) + 1);
  setrlimit(RLIMIT_CPU, &most);
}

inline void write_line(const nlohmann::ordered_json& json, std::FILE* out) {
  std::fprintf(out, "%s\n", json.dump().c_str());
  std::fflush(out);
}

/// work(job, file) for each job in a process of its own, and add(json) for each line that they have written.
template <class Work, class Add>
void in_jobs(std::size_t jobs, const Work& work, const Add& add) {
  std::vector<std::FILE*> files;
  std::vector<pid_t> processes;
  for (std::size_t job = 0; job < jobs; ++job) {
    std::FILE* file = std::tmpfile();
    const pid_t process = fork();
    if (process == 0) {
      work(job, file);
      _exit(0);
    }
    files.push_back(file), processes.push_back(process);
  }
  for (std::size_t job = 0; job < jobs; ++job) {
    int status = 0;
    waitpid(processes[job], &status, 0);
    if (status != 0) throw std::runtime_error("a process of the study ended early");
    std::rewind(files[job]);
    std::string line;
    for (int c = 0; (c = std::fgetc(files[job])) != EOF;) {
      if (c != '\n') {
        line += char(c);
        continue;
      }
      add(nlohmann::ordered_json::parse(line));
      line.clear();
    }
  }
}

/// What work() of a process of its own writes to a channel, and its status.
template <class Work>
std::string in_process(const Work& work, int& status) {
  int channel[2];
  if (pipe(channel) != 0) throw std::runtime_error("no pipe");
  const pid_t child = fork();
  if (child == 0) _exit(work(channel[1]) ? 0 : 3);
  close(channel[1]);
  std::string text;
  char buffer[4096];
  for (ssize_t got = 0; (got = read(channel[0], buffer, sizeof buffer)) > 0;) text.append(buffer, std::size_t(got));
  close(channel[0]);
  waitpid(child, &status, 0);
  return text;
}

inline bool write_whole(int channel, const std::string& text) {
  return write(channel, text.data(), text.size()) == ssize_t(text.size());
}

inline bool is_out_of_time(int status) {
  return WIFSIGNALED(status) && (WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL);
}

}  // namespace bromwich
