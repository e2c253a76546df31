import { strict as assert } from "node:assert";
import { test } from "node:test";
import { axisLabel, digitsOf, duration, interval, number, quantity } from "../src/shared/format.ts";

test("numbers keep significant digits, not decimals", () => {
  assert.equal(number(0), "0");
  assert.equal(number(1.23456), "1.235");
  assert.equal(number(0.0123456, 3), "0.0123");
  assert.equal(number(123456), "123456");
  assert.equal(number(-2.5), "−2.5");
  assert.equal(number(2, 4), "2");
  assert.equal(number(9.9996, 4), "10");
});

test("very small and very large numbers have a power of ten", () => {
  assert.equal(number(1.5e-7, 3), "1.5×10⁻⁷");
  assert.equal(number(-6.18e12, 3), "−6.18×10¹²");
});

test("what is no number says so", () => {
  assert.equal(number(NaN), "–");
  assert.equal(number(null), "–");
  assert.equal(number(Infinity), "∞");
  assert.equal(quantity(NaN, "N"), "–");
});

test("a unit follows after a narrow space that does not break", () => {
  assert.equal(quantity(12.5, "mm"), "12.5\u202fmm");
  assert.equal(quantity(12.5, ""), "12.5");
  assert.equal(axisLabel("force", "N"), "force (N)");
});

test("digits follow the width of an interval", () => {
  assert.equal(interval(1.23456, 1.1, 1.36), "1.23 [1.1, 1.36]");
  assert.equal(interval(1.23456, -Infinity, 1.36), "1.23 […, 1.36]");
  assert.equal(digitsOf(100, 0.1), 5);
});

test("durations read as people say them", () => {
  assert.equal(duration(0.05), "50\u202fms");
  assert.equal(duration(12.34), "12.3\u202fs");
  assert.equal(duration(250), "4\u202fmin 10\u202fs");
  assert.equal(duration(7500), "2\u202fh 05\u202fmin");
  assert.equal(duration(273600), "3\u202fd 4\u202fh");
});
