// The inks of the page's theme, and what drawings are made with.
const brushes = (function () {
  "use strict";
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const EARLY_TO_LATE = {
    light: [[240, 160, 40], [217, 72, 95], [125, 45, 150], [30, 30, 105]],
    dark: [[120, 90, 220], [205, 85, 150], [245, 145, 75], [255, 230, 145]]
  };
  const ink = {};

  function inks() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "faint", "line", "paper", "floor", "block", "robot", "first", "second", "third"]) {
      ink[name] = style.getPropertyValue("--" + name).trim();
    }
    ink.times = EARLY_TO_LATE[dark.matches ? "dark" : "light"];
    ink.hatch = hatched();
  }

  function hatched() {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 10;
    const brush = tile.getContext("2d");
    brush.strokeStyle = ink.faint;
    for (const shift of [-10, 0, 10]) {
      brush.moveTo(shift, 10);
      brush.lineTo(shift + 10, 0);
    }
    brush.stroke();
    return brush.createPattern(tile, "repeat");
  }

  // The colour of a share of the drive's time.
  function timeColour(share) {
    const place = Math.min(Math.max(share, 0), 1) * (ink.times.length - 1);
    const index = Math.min(Math.floor(place), ink.times.length - 2);
    const mixed = ink.times[index].map((from, at) =>
      Math.round(from + (place - index) * (ink.times[index + 1][at] - from)));
    return "rgb(" + mixed.join(",") + ")";
  }

  // Round numbers between two ends, about so many.
  function ticks(low, high, count) {
    const rough = (high - low) / count;
    const power = Math.pow(10, Math.floor(Math.log10(rough)));
    const step = power * [1, 2, 5, 10].find((one) => one * power >= rough);
    const places = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) places.push(k * step);
    return { step: step, places: places, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  }

  function sized(one, brush, width, height) {
    const scale = window.devicePixelRatio || 1;
    one.style.height = height + "px";
    one.width = Math.round(width * scale);
    one.height = Math.round(height * scale);
    brush.setTransform(scale, 0, 0, scale, 0, 0);
    one.wide = width;
    one.high = height;
  }

  function line(brush, colour, width, points, dashes) {
    brush.beginPath();
    points.forEach((point) => brush.lineTo(point[0], point[1]));
    brush.strokeStyle = colour;
    brush.lineWidth = width;
    brush.setLineDash(dashes || []);
    brush.stroke();
    brush.setLineDash([]);
  }

  function word(brush, text, x, y, align, base, colour) {
    brush.font = "12px system-ui, sans-serif";
    brush.textAlign = align;
    brush.textBaseline = base;
    brush.fillStyle = colour || ink.faint;
    brush.fillText(text, x, y);
  }

  dark.addEventListener("change", inks);
  inks();
  return { dark: dark, ink: ink, timeColour: timeColour, ticks: ticks, sized: sized, line: line, word: word };
})();
