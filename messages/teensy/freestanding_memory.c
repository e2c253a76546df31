#include <stddef.h>

/* The four functions a compiler may call in freestanding code (GCC manual, "Standards"). On the Teensy they come
   from newlib; here they complete the link that shows that nothing else is needed. */

void* memcpy(void* to, const void* from, size_t size) {
  for (size_t i = 0; i < size; ++i) ((unsigned char*)to)[i] = ((const unsigned char*)from)[i];
  return to;
}

void* memmove(void* to, const void* from, size_t size) {
  if ((const char*)from >= (const char*)to) return memcpy(to, from, size);
  for (size_t i = size; i-- > 0;) ((unsigned char*)to)[i] = ((const unsigned char*)from)[i];
  return to;
}

void* memset(void* to, int value, size_t size) {
  for (size_t i = 0; i < size; ++i) ((unsigned char*)to)[i] = (unsigned char)value;
  return to;
}

int memcmp(const void* a, const void* b, size_t size) {
  for (size_t i = 0; i < size; ++i) {
    const int difference = ((const unsigned char*)a)[i] - ((const unsigned char*)b)[i];
    if (difference != 0) return difference;
  }
  return 0;
}
