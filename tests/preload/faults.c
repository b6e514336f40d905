/* Calls of the system that fail: the n-th `write`, `pwrite`, `ftruncate`, `fsync`, `rename` or `close` on a file below a
   folder, with all after it where that lasts (`fault_arm`), or every lock (environment variable FAULT_LOCKS with the number
   of the error).
   cc -shared -fPIC faults.c -o faults.so -ldl */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

static char call_name[16], folder[PATH_MAX];
static long nth, counted;
static int number, lasting;

void fault_arm(const char *name, long n, int error, int lasts, const char *below) {
  snprintf(call_name, sizeof call_name, "%s", name);
  snprintf(folder, sizeof folder, "%s", below);
  nth = n; number = error; lasting = lasts; counted = 0;
}
long fault_count(void) { return counted; }

static int below(int fd) {
  char link[64], path[PATH_MAX];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t size = readlink(link, path, sizeof path - 1);
  if (size <= 0) return 0;
  path[size] = 0;
  return !strncmp(path, folder, strlen(folder));
}
static int fails(const char *name, int ours) {
  if (!folder[0] || strcmp(name, call_name) || !ours || ++counted < nth || !nth || (counted > nth && !lasting)) return 0;
  errno = number;
  return 1;
}
#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

ssize_t write(int fd, const void *b, size_t n) { return fails("write", below(fd)) ? -1 : REAL(write)(fd, b, n); }
ssize_t pwrite(int fd, const void *b, size_t n, off_t o) { return fails("pwrite", below(fd)) ? -1 : REAL(pwrite)(fd, b, n, o); }
ssize_t pwrite64(int fd, const void *b, size_t n, off64_t o) { return fails("pwrite", below(fd)) ? -1 : REAL(pwrite64)(fd, b, n, o); }
int ftruncate(int fd, off_t n) { return fails("ftruncate", below(fd)) ? -1 : REAL(ftruncate)(fd, n); }
int ftruncate64(int fd, off64_t n) { return fails("ftruncate", below(fd)) ? -1 : REAL(ftruncate64)(fd, n); }
int fsync(int fd) { return fails("fsync", below(fd)) ? -1 : REAL(fsync)(fd); }
int rename(const char *a, const char *b) { return fails("rename", !strncmp(b, folder, strlen(folder))) ? -1 : REAL(rename)(a, b); }
int close(int fd) {
  int bad = folder[0] && fails("close", below(fd)), kept = errno, ended = REAL(close)(fd);
  if (bad) { errno = kept; return -1; }
  return ended;
}

static int unlocked(void) {
  const char *told = getenv("FAULT_LOCKS");
  if (told) errno = atoi(told);
  return told != 0;
}
int flock(int fd, int op) { return unlocked() ? -1 : REAL(flock)(fd, op); }
int fcntl64(int fd, int op, ...) {
  va_list rest; va_start(rest, op); void *given = va_arg(rest, void *); va_end(rest);
  if ((op == F_SETLK || op == F_SETLKW || op == F_OFD_SETLK || op == F_OFD_SETLKW) && unlocked()) return -1;
  return REAL(fcntl64)(fd, op, given);
}
int fcntl(int fd, int op, ...) {
  va_list rest; va_start(rest, op); void *given = va_arg(rest, void *); va_end(rest);
  if ((op == F_SETLK || op == F_SETLKW || op == F_OFD_SETLK || op == F_OFD_SETLKW) && unlocked()) return -1;
  return REAL(fcntl)(fd, op, given);
}
