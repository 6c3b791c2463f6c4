// Plays each drive: the robot on its path in the room, and its inputs over time with a cursor.
document.querySelectorAll(".player").forEach(function (player) {
  "use strict";
  const data = JSON.parse(player.querySelector("script").textContent);
  const canvas = player.querySelector("canvas.path");
  const strip = player.querySelector("canvas.inputs");
  const button = player.querySelector("button");
  const choice = player.querySelector("select.drive");
  const rate = player.querySelector("select.rate");
  const loop = player.querySelector("input.loop");
  const slider = player.querySelector("input.time");
  const clock = player.querySelector("output");
  const context = canvas.getContext("2d");
  const inputs = inputsOn(strip, data.charts);
  const { dark, ink, timeColour, ticks, sized, line, word } = brushes;
  const [left, right, bottom, top] = data.view;
  const ROOM = { left: 44, right: 12, top: 12, bottom: 36 };
  let drive = data.drives[0];
  let spins = spinsOf(drive);
  let time = 0;
  let before = null;

  function armOf() { return Math.max(data.width / 2, 0.02 * (right - left)); }

  // Stretches in which the robot turns in place: first and last sample.
  function spinsOf(one) {
    const arm = armOf();
    const found = [];
    for (let k = 0; k + 1 < one.x.length; k += 1) {
      const turn = one.heading[k + 1] - one.heading[k];
      const step = Math.hypot(one.x[k + 1] - one.x[k], one.y[k + 1] - one.y[k]);
      if (Math.abs(turn) < 2e-3 || step > 0.15 * arm * Math.abs(turn)) continue;
      const last = found[found.length - 1];
      if (last && last.to === k && last.turn * turn > 0) {
        last.to = k + 1;
        last.turn += turn;
      } else found.push({ from: k, to: k + 1, turn: turn });
    }
    return found.filter((spin) => Math.abs(spin.turn) > 0.6).map(function (spin, number, every) {
      const near = every.slice(0, number).filter((other) =>
        Math.hypot(one.x[other.from] - one.x[spin.from], one.y[other.from] - one.y[spin.from]) < arm);
      return Object.assign(spin, { level: near.length });
    });
  }

  function fit() {
    const width = canvas.parentNode.clientWidth;
    const inner = width - ROOM.left - ROOM.right;
    const tall = inner * (top - bottom) / (right - left) + ROOM.top + ROOM.bottom;
    sized(canvas, context, width, Math.min(Math.max(tall, 180), 470));
    inputs.fit();
    draw();
  }

  function pose() {
    const last = drive.x.length - 1;
    const position = Math.min(time / drive.duration, 1) * last;
    const index = Math.min(Math.floor(position), last - 1);
    const share = position - index;
    const between = (values) => values[index] + share * (values[index + 1] - values[index]);
    return {
      x: between(drive.x), y: between(drive.y), heading: between(drive.heading),
      trailer: drive.trailer ? between(drive.trailer) : 0, index: index
    };
  }

  function view() {
    const width = canvas.wide - ROOM.left - ROOM.right;
    const height = canvas.high - ROOM.top - ROOM.bottom;
    const scale = Math.min(width / (right - left), height / (top - bottom));
    const middleX = ROOM.left + width / 2;
    const middleY = ROOM.top + height / 2;
    return {
      width: width, height: height, scale: scale,
      toX: (x) => middleX + (x - (left + right) / 2) * scale,
      toY: (y) => middleY - (y - (bottom + top) / 2) * scale,
      fromX: (x) => (x - middleX) / scale + (left + right) / 2,
      fromY: (y) => (middleY - y) / scale + (bottom + top) / 2
    };
  }

  function drawRoom(at) {
    const shape = function (outline, fill) {
      context.beginPath();
      if (outline.points) {
        outline.points.forEach((point) => context.lineTo(at.toX(point[0]), at.toY(point[1])));
        context.closePath();
      } else context.arc(at.toX(outline.x), at.toY(outline.y), outline.radius * at.scale, 0, 2 * Math.PI);
      context.fillStyle = fill;
      context.strokeStyle = ink.faint;
      context.lineWidth = 1.2;
      context.fill();
      context.stroke();
    };
    context.save();
    context.beginPath();
    context.rect(ROOM.left, ROOM.top, at.width, at.height);
    context.clip();
    if (data.workspace) shape(data.workspace, ink.floor);
    data.obstacles.forEach(function (obstacle) {
      shape(obstacle, ink.block);
      shape(obstacle, ink.hatch);
    });
    context.restore();
  }

  function drawAxes(at) {
    const end = ROOM.left + at.width;
    const floor = ROOM.top + at.height;
    const across = ticks(at.fromX(ROOM.left), at.fromX(end), at.width / 80);
    const up = ticks(at.fromY(floor), at.fromY(ROOM.top), at.height / 60);
    line(context, ink.line, 1, [[ROOM.left, ROOM.top], [ROOM.left, floor], [end, floor]]);
    across.places.forEach(function (x) {
      line(context, ink.line, 1, [[at.toX(x), floor], [at.toX(x), floor + 4]]);
      word(context, x.toFixed(across.digits), at.toX(x), floor + 7, "center", "top");
    });
    up.places.forEach(function (y) {
      line(context, ink.line, 1, [[ROOM.left - 4, at.toY(y)], [ROOM.left, at.toY(y)]]);
      word(context, y.toFixed(up.digits), ROOM.left - 7, at.toY(y), "right", "middle");
    });
    word(context, "x [m]", end, floor + 22, "right", "top");
    word(context, "y [m]", ROOM.left + 6, ROOM.top, "left", "top");
    // The bar is as long as a round number of metres, and below the axis, where no wall or path is.
    const bar = ticks(0, at.width / at.scale, 9).step;
    const to = ROOM.left + bar * at.scale;
    line(context, ink.ink, 2, [[ROOM.left, floor + 28], [to, floor + 28]]);
    word(context, bar + " m", to + 7, floor + 28, "left", "middle", ink.ink);
  }

  // Where simulated robots with other parameters go; what is beyond the axes is cut.
  function drawRobots(at) {
    context.save();
    context.beginPath();
    context.rect(ROOM.left, ROOM.top, at.width, at.height);
    context.clip();
    context.globalAlpha = 0.55;
    (drive.robots || []).forEach(function (path) {
      line(context, ink.faint, 0.7, path.map((point) => [at.toX(point[0]), at.toY(point[1])]));
    });
    context.restore();
  }

  function drawPath(at, now) {
    const last = drive.x.length - 1;
    const started = time > 0 && time < drive.duration;
    const faded = (k) => { context.globalAlpha = started && k > now.index ? 0.28 : 1; };
    drawRobots(at);
    context.lineCap = "round";
    for (let k = 0; k < last; k += 1) {
      faded(k);
      const points = [k, k + 1].map((one) => [at.toX(drive.x[one]), at.toY(drive.y[one])]);
      line(context, timeColour(k / last), 3, points);
    }
    context.lineCap = "butt";
    const every = Math.max(1, Math.round(last / 25));
    for (let k = 0; k <= last; k += every) {
      faded(k);
      const x = at.toX(drive.x[k]);
      const y = at.toY(drive.y[k]);
      line(context, timeColour(k / last), 1.4,
        [[x, y], [x + 11 * Math.cos(drive.heading[k]), y - 11 * Math.sin(drive.heading[k])]]);
    }
    spins.forEach(function (spin) {
      faded(spin.to);
      drawSpin(at, spin, last);
    });
    context.globalAlpha = 1;
    drawEnds(at, last);
  }

  function spinBase(at, spin) { return Math.max(0.55 * data.width * at.scale, 13) + 7 * spin.level; }

  function spinGrowth(spin) { return Math.min(5 * Math.abs(spin.turn) / (2 * Math.PI), 30); }

  // Of all turns about that place, so that they stay apart.
  function widest(at, spin) {
    const there = spins.filter((other) =>
      Math.hypot(drive.x[other.from] - drive.x[spin.from], drive.y[other.from] - drive.y[spin.from]) < armOf());
    return Math.max(...there.map((other) => spinBase(at, other) + spinGrowth(other)));
  }

  // How wide arcs may be drawn: about the robot, and not across a wall as if it left the room.
  function spinRoom(at, x, y) {
    let most = Math.max(0.8 * data.width * at.scale, 30);
    if (data.workspace && data.workspace.radius) {
      const centre = Math.hypot(x - data.workspace.x, y - data.workspace.y);
      most = Math.min(most, (data.workspace.radius - centre) * at.scale);
    } else if (data.workspace) {
      data.workspace.points.forEach(function (to, number, every) {
        const from = every[(number + every.length - 1) % every.length];
        const [along, up] = [to[0] - from[0], to[1] - from[1]];
        const share = ((x - from[0]) * along + (y - from[1]) * up) / (along * along + up * up);
        const near = Math.min(Math.max(share, 0), 1);
        most = Math.min(most, Math.hypot(x - from[0] - near * along, y - from[1] - near * up) * at.scale);
      });
    }
    return Math.max(most - 2, 9);
  }

  // A turn in place: an arc about the robot, wider with every turn, with an arrow at its end.
  function drawSpin(at, spin, last) {
    const x = at.toX(drive.x[spin.from]);
    const y = at.toY(drive.y[spin.from]);
    const shrunk = Math.min(1, spinRoom(at, drive.x[spin.from], drive.y[spin.from]) / widest(at, spin));
    // Where a spiral would be a blot it is a ring, and its turns are counted.
    const turns = Math.abs(spin.turn) / (2 * Math.PI);
    const ring = shrunk < 0.6 && turns > 1.5;
    const base = spinBase(at, spin) * shrunk + (ring ? spinGrowth(spin) * shrunk : 0);
    if (ring) {
      const side = drive.x[spin.from] > (left + right) / 2 ? -1 : 1;
      const beside = side < 0 ? "right" : "left";
      word(context, turns.toFixed(1) + " turns", x - side * base, y - base - 6, beside, "bottom", ink.ink);
    }
    const pieces = Math.max(8, Math.ceil(Math.abs(spin.turn) / 0.12));
    const place = function (share) {
      const angle = drive.heading[spin.from] + share * spin.turn;
      const radius = base + (ring ? 0 : spinGrowth(spin) * shrunk * share);
      return [x + radius * Math.cos(angle), y - radius * Math.sin(angle)];
    };
    for (let k = 0; k < pieces; k += 1) {
      const share = (spin.from + (k / pieces) * (spin.to - spin.from)) / last;
      line(context, timeColour(share), 2.4, [place(k / pieces), place((k + 1) / pieces)]);
    }
    const tip = place(1);
    const angle = Math.atan2(tip[1] - place(1 - 1 / pieces)[1], tip[0] - place(1 - 1 / pieces)[0]);
    const barb = (side) => [tip[0] - 8 * Math.cos(angle + side), tip[1] - 8 * Math.sin(angle + side)];
    line(context, timeColour(spin.to / last), 2.4, [barb(0.5), tip, barb(-0.5)]);
  }

  function drawEnds(at, last) {
    context.fillStyle = ink.paper;
    context.strokeStyle = ink.ink;
    context.lineWidth = 1.6;
    context.beginPath();
    context.arc(at.toX(drive.x[0]), at.toY(drive.y[0]), 4.5, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
    context.fillStyle = ink.ink;
    context.fillRect(at.toX(drive.x[last]) - 3.5, at.toY(drive.y[last]) - 3.5, 7, 7);
  }

  // From the hitch to the trailer's axle and its wheels, in the tractor's frame.
  function tow(angle, offset, length, half) {
    context.save();
    context.lineWidth = 3;
    context.strokeStyle = ink.faint;
    context.beginPath();
    context.moveTo(0, 0);
    context.lineTo(-offset, 0);
    context.translate(-offset, 0);
    context.rotate(-angle);
    context.lineTo(-length, 0);
    context.moveTo(-length, -0.9 * half);
    context.lineTo(-length, 0.9 * half);
    context.stroke();
    context.beginPath();
    context.arc(0, 0, context.lineWidth, 0, 2 * Math.PI);
    context.fillStyle = ink.ink;
    context.fill();
    context.restore();
  }

  function drawRobot(at, now) {
    const half = Math.max(data.width * at.scale / 2, 7);
    context.save();
    context.translate(at.toX(now.x), at.toY(now.y));
    context.rotate(-now.heading);
    context.strokeStyle = ink.ink;
    if (data.body_radius) {
      context.beginPath();
      context.arc(0, 0, data.body_radius * at.scale, 0, 2 * Math.PI);
      context.lineWidth = 1;
      context.stroke();
    }
    if (data.trailer) tow(now.trailer, data.trailer[0] * at.scale, data.trailer[1] * at.scale, half);
    context.beginPath();
    context.moveTo(1.3 * half, 0);
    context.lineTo(-0.6 * half, half);
    context.lineTo(-0.2 * half, 0);
    context.lineTo(-0.6 * half, -half);
    context.closePath();
    context.fillStyle = ink.robot;
    context.strokeStyle = ink.ink;
    context.lineWidth = 1.2;
    context.globalAlpha = 0.85;
    context.fill();
    context.globalAlpha = 1;
    context.stroke();
    context.restore();
  }

  function draw() {
    // A frame that is not shown has no room for anything.
    if (canvas.wide <= ROOM.left + ROOM.right) return;
    const at = view();
    const now = pose();
    context.clearRect(0, 0, canvas.wide, canvas.high);
    drawRoom(at);
    drawAxes(at);
    drawPath(at, now);
    drawRobot(at, now);
    inputs.draw(drive, time);
    slider.value = String(1000 * time / drive.duration);
    const colours = [0, 0.25, 0.5, 0.75, 1].map(timeColour).join(",");
    slider.style.background = "linear-gradient(to right," + colours + ")";
    clock.textContent = time.toFixed(1) + " s of " + drive.duration.toFixed(1) + " s";
    player.dataset.time = time.toFixed(3);
    player.dataset.x = now.x.toFixed(4);
    player.dataset.y = now.y.toFixed(4);
    player.dataset.heading = now.heading.toFixed(4);
  }

  function stop() {
    before = null;
    button.textContent = "Play";
  }

  function tick(stamp) {
    if (before === null) return;
    time += Number(rate.value) * Math.max(0, stamp - before) / 1000;
    before = stamp;
    if (time >= drive.duration) {
      if (loop.checked) time %= drive.duration;
      else {
        time = drive.duration;
        stop();
      }
    }
    draw();
    if (before !== null) requestAnimationFrame(tick);
  }

  // A click or a drag over the inputs is a time.
  function seek(event) {
    if (event.type === "pointermove" && !event.buttons) return;
    time = drive.duration * inputs.shareAt(event);
    draw();
  }

  button.addEventListener("click", function () {
    if (before !== null) return stop();
    if (time >= drive.duration) time = 0;
    button.textContent = "Pause";
    before = performance.now();
    requestAnimationFrame(tick);
  });
  choice.addEventListener("change", function () {
    drive = data.drives[Number(choice.value)];
    spins = spinsOf(drive);
    time = 0;
    draw();
  });
  slider.addEventListener("input", function () {
    time = drive.duration * Number(slider.value) / 1000;
    draw();
  });
  strip.addEventListener("pointerdown", seek);
  strip.addEventListener("pointermove", seek);
  dark.addEventListener("change", draw);
  window.addEventListener("resize", fit);
  fit();
  // A link to #play starts at once.
  if (window.location.hash === "#play") button.click();
});
