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
const HOUR = new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", hour12: false });

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function axes(units, isTime) {
  const stroke = colour("--text");
  const grid = { stroke: colour("--line"), width: 1 };
  return [{ stroke, grid, ...(isTime ? { values: (_, times) => times.map((time) => HOUR.format(time * 1000)) } : {}) }, ...units.map((unit, index) => ({ stroke, grid: index ? { show: false } : grid, scale: unit, side: index ? 1 : 3, label: unit, labelSize: 20, size: 55 }))];
}

async function draw(place, options, data) {
  const Plot = await uPlot();
  if (!Plot) {
    place.replaceChildren(h("p", { class: "hint" }, "No plots: run make web in this gateway's checkout."));
    return;
  }
  const width = Math.max(place.clientWidth, 200);
  const shape = JSON.stringify([options.series.map((series) => series.label), width]);
  if (place.plot && place.shape === shape) {
    place.plot.setData(data);
    return;
  }
  place.plot?.destroy();
  place.replaceChildren();
  place.shape = shape;
  place.plot = new Plot({ width, height: HEIGHT, ...options }, data, place);
}

/** Draws current and voltage of the last hour. */
export async function plotTime(place, plots) {
  const end = Date.parse(plots.end) / 1000;
  const count = Math.max(plots.current?.length ?? 0, plots.voltage?.length ?? 0);
  const times = Array.from({ length: count }, (_, index) => end - (count - 1 - index) * plots.step_s);
  const series = [{ label: "time", value: (_, time) => (time === null ? "" : HOUR.format(time * 1000)) }];
  const data = [times];
  const units = [];
  for (const [name, dash] of [["current", undefined], ["voltage", [6, 4]]]) {
    const values = plots[name];
    if (!values?.some((value) => value !== null)) continue;
    const unit = plots[`${name}_unit`] || " ";
    if (!units.includes(unit)) units.push(unit);
    series.push({ label: `${name}, ${unit}`, scale: unit, stroke: colour(name === "current" ? "--text" : "--plot-b"), width: 1.5, dash, spanGaps: false });
    data.push(values);
  }
  if (data.length === 1) {
    place.plot?.destroy();
    place.plot = null;
    place.replaceChildren(h("p", { class: "hint" }, "Nothing has been read in the last hour."));
    return;
  }
  await draw(place, { series, axes: axes(units, true), scales: { x: { time: true } } }, data);
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
  const shownAxes = axes(drawn.slice(0, 2).map(([name]) => name), false);
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
  await draw(place, { series, axes: axes(["A"], false), scales: { x: { time: false } } }, data);
}
