// Plots with uPlot, which is loaded only where something is plotted.

import { h } from "./dom.js";

let loading = null;

/** Returns uPlot, or null where the package was built without it. */
function uPlot() {
  loading ??= new Promise((resolve) => {
    const style = h("link", { rel: "stylesheet", href: "static/vendor/uPlot.min.css" });
    const script = h("script", { src: "static/vendor/uPlot.iife.min.js" });
    script.onload = () => resolve(window.uPlot ?? null);
    script.onerror = () => resolve(null);
    document.head.append(style, script);
  });
  return loading;
}

const HEIGHT = 200;
const DAY = new Intl.DateTimeFormat([], { day: "2-digit", month: "2-digit" });
const HOUR = new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", hour12: false });

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function axes(units, time = null) {
  const stroke = colour("--text");
  const grid = { stroke: colour("--line"), width: 1 };
  return [{ stroke, grid, ...(time ? { values: (_, times) => times.map((at) => time.format(at * 1000)) } : {}) }, ...units.map((unit, index) => ({ stroke, grid: index ? { show: false } : grid, scale: unit, side: index ? 1 : 3, label: unit, labelSize: 20, size: 55 }))];
}

async function draw(place, options, data, kind = "") {
  const Plot = await uPlot();
  if (!Plot) {
    place.replaceChildren(h("p", { class: "hint" }, "No plots: run make web in this gateway's checkout."));
    return;
  }
  const width = Math.max(place.clientWidth, 200);
  const shape = JSON.stringify([options.series.map((series) => series.label), width, kind]);
  if (place.plot && place.shape === shape) {
    place.plot.setData(data);
    return;
  }
  place.plot?.destroy();
  place.replaceChildren();
  place.shape = shape;
  place.plot = new Plot({ width, height: HEIGHT, ...options }, data, place);
}

const MARKS = { S: ["--text", 11], T: ["--plot-f", 22], C: ["--plot-b", 33] }; // colour, and pixels from the top to the letter
const MARK_APART_PX = 9; // letters nearer than this would cover one another

/** Draws one point over time: its last values as a line in the band of the least and the most; `marks` are [milliseconds, letter]. */
export async function plotTrace(place, trace, isDays, marks) {
  place.marks = marks;
  const end = Date.parse(trace.end) / 1000;
  const times = trace.last.map((_, index) => end - (trace.last.length - 1 - index) * trace.step_s);
  if (!trace.most.some((value) => value !== null)) {
    place.plot?.destroy();
    place.plot = null;
    place.replaceChildren(h("p", { class: "hint" }, "Nothing is known of this time."));
    return;
  }
  const unit = trace.unit || " ";
  const time = isDays ? DAY : HOUR;
  const line = (label, width) => ({ label, scale: unit, width, stroke: colour("--plot-b"), spanGaps: false });
  const series = [{ label: "time", value: (_, at) => (at === null ? "" : `${isDays ? `${DAY.format(at * 1000)} ` : ""}${HOUR.format(at * 1000)}`) },
    line(`least, ${unit}`, 0.5), line(`most, ${unit}`, 0.5), { ...line(`${trace.point.replaceAll("_", " ")}, ${unit}`, 2), stroke: colour("--text") }];
  const bands = [{ series: [2, 1], fill: `color-mix(in srgb, ${colour("--plot-b")} 30%, transparent)` }];
  await draw(place, { series, bands, axes: axes([unit], time), scales: { x: { time: true } }, hooks: { draw: [(plot) => drawMarks(plot, place.marks)] } }, [times, trace.least, trace.most, trace.last], isDays);
}

function drawMarks(plot, marks) {
  const { ctx, bbox } = plot;
  const ratio = window.devicePixelRatio;
  const last = {};
  ctx.save();
  ctx.font = `700 ${11 * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "center";
  for (const [at, letter] of marks) {
    const x = plot.valToPos(at / 1000, "x", true);
    if (!(x >= bbox.left && x <= bbox.left + bbox.width)) continue;
    const [name, top] = MARKS[letter];
    ctx.strokeStyle = ctx.fillStyle = colour(name);
    ctx.lineWidth = ratio;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top + (top + 3) * ratio);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.globalAlpha = 0.5;
    ctx.stroke();
    ctx.globalAlpha = 1;
    if (!(x - last[letter] < MARK_APART_PX * ratio)) {
      ctx.fillText(letter, x, bbox.top + top * ratio);
      last[letter] = x;
    }
  }
  ctx.restore();
}

const TRIP_COLOURS = ["--text", "--plot-b", "--muted", "--c"];

/** Draws what was read before a trip, from seconds before it to the trip; each point has a scale of its own, the first two have axes. */
export async function plotTrip(place, { t_s: times = [], points = {} }, units) {
  const drawn = Object.entries(points)
    .filter(([, values]) => values.filter((value) => typeof value === "number").length > 1)
    .slice(0, TRIP_COLOURS.length);
  if (!drawn.length) {
    place.hidden = true;
    return;
  }
  const series = [{ label: "seconds", value: (_, time) => (time === null ? "" : time.toFixed(1)) }];
  drawn.forEach(([name], index) => series.push({ label: units[name] ? `${name}, ${units[name]}` : name, scale: name, spanGaps: true, width: 1.5,
    stroke: colour(TRIP_COLOURS[index]), dash: index ? [2 + 3 * index, 3] : undefined }));
  const shownAxes = axes(drawn.slice(0, 2).map(([name]) => name));
  await draw(place, { series, axes: shownAxes, scales: { x: { time: false } } }, [times, ...drawn.map(([, values]) => values.map((value) => (typeof value === "number" ? value : undefined)))]);
}

/** Draws the currents of starts over each other, from the moment of the start; the last one is thick, those of the baseline are dashed. */
export async function plotStarts(place, starts) {
  const drawable = starts.filter((start) => start.samples?.t_s?.length && start.samples.current);
  if (!drawable.length) {
    place.replaceChildren();
    place.plot = null;
    place.hidden = true;
    return;
  }
  place.hidden = false;
  const times = [...new Set(drawable.flatMap((start) => start.samples.t_s))].sort((a, b) => a - b);
  const at = new Map(times.map((time, index) => [time, index]));
  const data = [times];
  const series = [{ label: "seconds", value: (_, time) => (time === null ? "" : time.toFixed(2)) }];
  drawable.forEach((start, index) => {
    const values = new Array(times.length).fill(undefined);
    start.samples.t_s.forEach((time, sample) => { values[at.get(time)] = start.samples.current[sample]; });
    data.push(values);
    const isLast = index === drawable.length - 1;
    const name = `${new Date(start.time).toLocaleTimeString([], { hour12: false })}${start.is_baseline ? " (baseline)" : ""}`;
    series.push({ label: name, scale: "A", spanGaps: true, width: isLast ? 2.5 : 1.5,
      stroke: colour(isLast ? "--text" : start.is_baseline ? "--plot-b" : "--muted"), dash: isLast || !start.is_baseline ? undefined : [6, 4] });
  });
  await draw(place, { series, axes: axes(["A"]), scales: { x: { time: false } } }, data);
}
