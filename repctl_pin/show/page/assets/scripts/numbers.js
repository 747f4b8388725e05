// Numbers as the tables and figures write them, too.

// 1.75; 0.0238; 2e-11
export function formatNumber(value) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  if (Math.abs(value) < 1e-3) return value.toExponential(0);
  return Math.abs(value) < 1000 ? String(Number(value.toPrecision(3))) : value.toFixed(0);
}

// 2 m; 45 cm; 2.6 mm
export function formatLength(value) {
  if (value < 1e-4) return "0";
  const [scale, unit] = value >= 0.995 ? [1, "m"] : value >= 0.00995 ? [100, "cm"] : [1000, "mm"];
  return `${Number((scale * value).toPrecision(2))} ${unit}`;
}

// The smallest of 1, 2, 5, 10, … that is no shorter than this.
export function stepAbove(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= length * 0.9999);
}

// The largest of 1, 2, 5, 10, … that is no longer than this.
export function niceStep(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return [5, 2, 1].map((k) => k * power).find((step) => step <= length * 1.0001) || power;
}
