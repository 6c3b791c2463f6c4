// The inputs of a drive over time, a panel for each quantity, with its limits and a cursor.
function inputsOn(strip, charts) {
  "use strict";
  const { ink, ticks, sized, line, word } = brushes;
  const chart = strip.getContext("2d");
  const PANEL = { left: 44, right: 64, top: 24, bottom: 32 };
  const HEIGHT = 170;

  function panel(number) {
    const width = strip.wide / charts.length;
    const from = number * width + PANEL.left;
    return { from: from, width: width - PANEL.left - PANEL.right, low: strip.high - PANEL.bottom, high: PANEL.top };
  }

  // What an input's panel shows: its limits with a band beyond them, or what all drives need.
  function range(drive, number) {
    const limits = charts[number].limits;
    if (limits) {
      const room = 0.14 * (limits[1] - limits[0]);
      return [limits[0] - room, limits[1] + room];
    }
    const every = drive.inputs[number].flat();
    const [low, high] = [Math.min(...every), Math.max(...every)];
    const room = 0.1 * (high - low) || 1;
    return [low - room, high + room];
  }

  function draw(drive, time) {
    chart.clearRect(0, 0, strip.wide, strip.high);
    charts.forEach(function (one, number) {
      const box = panel(number);
      const [low, high] = range(drive, number);
      const toX = (share) => box.from + share * box.width;
      const toY = (value) => box.low - (value - low) / (high - low) * (box.low - box.high);
      if (one.limits) {
        chart.fillStyle = ink.block;
        chart.fillRect(box.from, box.high, box.width, toY(one.limits[1]) - box.high);
        chart.fillRect(box.from, toY(one.limits[0]), box.width, box.low - toY(one.limits[0]));
      }
      drawScale(drive, one, box, low, high, toX, toY);
      chart.save();
      chart.beginPath();
      chart.rect(box.from, box.high, box.width + PANEL.right, box.low - box.high);
      chart.clip();
      const tails = [];
      drive.inputs[number].forEach(function (values, at) {
        const last = values.length - 1;
        const colour = [ink.first, ink.second, ink.third, ink.faint][at % 4];
        const points = [];
        values.forEach(function (value, k) {
          if (drive.steps && k) points.push([toX(k / last), toY(values[k - 1])]);
          points.push([toX(k / last), toY(value)]);
        });
        line(chart, colour, 2, points, [[], [7, 3], [2, 2], [9, 3, 2, 3]][at % 4]);
        tails.push({ text: one.labels[at], y: points[last][1], colour: colour });
      });
      chart.restore();
      label(tails, box);
      line(chart, ink.ink, 1.2, [[toX(time / drive.duration), box.high], [toX(time / drive.duration), box.low]]);
    });
    strip.dataset.time = time.toFixed(3);
  }

  // Names at the ends of lines, moved apart where they would cover each other.
  function label(tails, box) {
    const sorted = tails.filter((one) => one.text).sort((one, other) => one.y - other.y);
    sorted.forEach(function (one, at) {
      if (at) one.y = Math.max(one.y, sorted[at - 1].y + 14);
    });
    const over = sorted.length ? sorted[sorted.length - 1].y - (box.low - 4) : 0;
    sorted.forEach(function (one) {
      word(chart, one.text, box.from + box.width + 6, one.y - Math.max(over, 0), "left", "middle", one.colour);
    });
  }

  function drawScale(drive, one, box, low, high, toX, toY) {
    const up = ticks(low, high, 4);
    const across = ticks(0, drive.duration, box.width / 90);
    up.places.forEach(function (value) {
      line(chart, ink.line, 0.6, [[box.from, toY(value)], [box.from + box.width, toY(value)]]);
      word(chart, value.toFixed(up.digits), box.from - 7, toY(value), "right", "middle");
    });
    line(chart, ink.line, 1, [[box.from, box.low], [box.from + box.width, box.low]]);
    across.places.forEach(function (seconds) {
      const x = toX(seconds / drive.duration);
      line(chart, ink.line, 1, [[x, box.low], [x, box.low + 4]]);
      word(chart, seconds.toFixed(across.digits), x, box.low + 7, "center", "top");
    });
    word(chart, one.title, box.from, 2, "left", "top", ink.ink);
    word(chart, "time [s]", box.from + box.width + 16, box.low + 7, "left", "top");
  }

  function fit() {
    sized(strip, chart, strip.parentNode.clientWidth, charts.length ? HEIGHT : 0);
  }

  // The share of a drive's time that a place over the panels is at.
  function shareAt(event) {
    const place = event.clientX - strip.getBoundingClientRect().left;
    const number = Math.min(Math.floor(place / strip.wide * charts.length), charts.length - 1);
    const box = panel(Math.max(number, 0));
    return Math.min(Math.max((place - box.from) / box.width, 0), 1);
  }

  return { draw: draw, fit: fit, shareAt: shareAt };
}
