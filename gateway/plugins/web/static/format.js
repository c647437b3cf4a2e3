// Numbers, ages and states in words; the NE 107 signals.

import { svg } from "./dom.js";

export function number(value, unit = "") {
  if (value === null || value === undefined) return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return String(value);
  const size = Math.abs(value);
  const digits = Number.isInteger(value) || size >= 1000 ? 0 : size >= 100 ? 1 : 2;
  const text = value.toFixed(digits);
  return unit ? `${text} ${unit}` : text;
}

export function age(seconds) {
  if (seconds === null || Number.isNaN(seconds)) return "never";
  const whole = Math.max(0, Math.floor(seconds));
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min`;
  if (whole < 172800) return `${Math.floor(whole / 3600)} h`;
  return `${Math.floor(whole / 86400)} d`;
}

/** A code of the contract as words. */
export function words(code) {
  return code.replaceAll("_", " ");
}

const ACTIONS = {
  "local_remote local": "switch to local", "local_remote remote": "switch to remote", "general_enable true": "general enable on", "general_enable false": "general enable off",
  "jog true": "jog", "jog false": "end jog",
};

/** A command that has a button, as words. */
export function actionWords(verb, args) {
  const said = [verb, ...Object.values(args ?? {}).map(String)].join(" ");
  return ACTIONS[said] ?? words(said);
}

export function clock(time) {
  return time ? new Date(time).toLocaleTimeString([], { hour12: false }) : "";
}

export function dateTime(time) {
  if (!time) return "";
  const at = new Date(time);
  const two = (part) => String(part).padStart(2, "0");
  return `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${clock(time)}`;
}

export function milliseconds(seconds) {
  return seconds === null || seconds === undefined ? "–" : `${(seconds * 1000).toFixed(1)} ms`;
}

export function percent(share) {
  return share === null || share === undefined ? "–" : `${(share * 100).toFixed(1)} %`;
}

/** NAMUR NE 107: what a person should think of this starter, most urgent first. */
export const SIGNALS = {
  F: "failure",
  C: "function check",
  S: "out of specification",
  M: "maintenance required",
  "": "normal",
};
export const RANK = { F: 0, C: 1, S: 2, M: 3, "": 4 };

const SHAPES = {
  F: () => svg("circle", { cx: 12, cy: 12, r: 11, class: "f" }),
  C: () => svg("path", { d: "M1 3h22L12 23z", class: "c" }),
  S: () => svg("path", { d: "M12 1 23 21H1z", class: "s" }),
  M: () => svg("rect", { x: 2, y: 2, width: 20, height: 20, class: "m" }),
};
const LETTER_AT = { F: 16.5, C: 12.5, S: 18.5, M: 16.5 };

/** A shape with its letter: colour never stands alone. */
export function signalSymbol(signal, isRunning) {
  const image = svg("svg", { viewBox: "0 0 24 24", class: "signal", role: "img" });
  const title = svg("title");
  title.append(signal ? SIGNALS[signal] : isRunning ? "normal, running" : "normal, stopped");
  image.append(title);
  if (!signal) {
    image.append(svg("circle", { cx: 12, cy: 12, r: 7, class: isRunning ? "on" : "off" }));
    return image;
  }
  const letter = svg("text", { x: 12, y: LETTER_AT[signal], "text-anchor": "middle", class: `letter ${signal}` });
  letter.append(signal);
  image.append(SHAPES[signal](), letter);
  return image;
}

/** A line of numbers, null where there was none. */
export function sparkline(values) {
  const image = svg("svg", { viewBox: "0 0 100 24", class: "spark", preserveAspectRatio: "none", "aria-hidden": "true" });
  const known = values.filter((value) => value !== null);
  if (known.length < 2) return image;
  const most = Math.max(...known, 1e-9);
  const step = 100 / Math.max(values.length - 1, 1);
  let path = "";
  let isDrawing = false;
  values.forEach((value, index) => {
    if (value === null) isDrawing = false;
    else {
      path += `${isDrawing ? "L" : "M"}${(index * step).toFixed(1)} ${(23 - (22 * value) / most).toFixed(1)}`;
      isDrawing = true;
    }
  });
  image.append(svg("path", { d: path }));
  return image;
}

/** A bar of a value against what is rated; its number stands beside it. */
export function fill(bar, share) {
  const width = `${Math.round(Math.min(Math.max(share, 0), 1) * 100)}%`;
  if (bar.style.width !== width) bar.style.width = width;
}
