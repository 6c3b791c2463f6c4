// Plays each drive: the robot along its path, with its trail, on one canvas.
document.querySelectorAll(".player").forEach(function (player) {
  "use strict";
  const data = JSON.parse(player.querySelector("script").textContent);
  const canvas = player.querySelector("canvas");
  const button = player.querySelector("button");
  const choice = player.querySelector("select.drive");
  const rate = player.querySelector("select.rate");
  const slider = player.querySelector("input");
  const clock = player.querySelector("output");
  const context = canvas.getContext("2d");
  const hatch = hatched();
  const [left, right, bottom, top] = data.view;
  let drive = data.drives[0];
  let time = 0;
  let before = null;

  function hatched() {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 10;
    const brush = tile.getContext("2d");
    brush.strokeStyle = "#4a4a4a";
    for (const shift of [-10, 0, 10]) {
      brush.moveTo(shift, 10);
      brush.lineTo(shift + 10, 0);
    }
    brush.stroke();
    return context.createPattern(tile, "repeat");
  }

  function fit() {
    const width = player.clientWidth;
    const scale = window.devicePixelRatio || 1;
    const height = Math.min(width * (top - bottom) / (right - left), 560);
    canvas.style.height = height + "px";
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
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

  // From the hitch to the trailer's axle and its wheels, in the tractor's frame.
  function tow(angle, offset, length, half) {
    context.save();
    context.lineWidth = 3 * (window.devicePixelRatio || 1);
    context.strokeStyle = "#5f5f5f";
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
    context.fillStyle = "#222222";
    context.fill();
    context.restore();
  }

  function draw() {
    const scale = Math.min(canvas.width / (right - left), canvas.height / (top - bottom));
    const toX = (x) => canvas.width / 2 + (x - (left + right) / 2) * scale;
    const toY = (y) => canvas.height / 2 - (y - (bottom + top) / 2) * scale;
    const now = pose();
    context.clearRect(0, 0, canvas.width, canvas.height);
    const shape = function (outline, fill, line) {
      context.beginPath();
      if (outline.points) {
        outline.points.forEach((point) => context.lineTo(toX(point[0]), toY(point[1])));
        context.closePath();
      } else context.arc(toX(outline.x), toY(outline.y), outline.radius * scale, 0, 2 * Math.PI);
      context.fillStyle = fill;
      context.strokeStyle = line;
      context.lineWidth = 1.5;
      context.fill();
      context.stroke();
    };
    if (data.workspace) shape(data.workspace, "#f4f4f1", "#767676");
    data.obstacles.forEach(function (obstacle) {
      shape(obstacle, "#c4c1ba", "#4a4a4a");
      shape(obstacle, hatch, "#4a4a4a");
    });
    const trace = function (count, colour, width) {
      context.beginPath();
      for (let k = 0; k <= count; k += 1) context.lineTo(toX(drive.x[k]), toY(drive.y[k]));
      if (count < drive.x.length - 1) context.lineTo(toX(now.x), toY(now.y));
      context.strokeStyle = colour;
      context.lineWidth = width * (window.devicePixelRatio || 1);
      context.stroke();
    };
    trace(drive.x.length - 1, "#c9d3dc", 1.5);
    trace(now.index, "#123f6d", 2.5);
    context.save();
    context.translate(toX(now.x), toY(now.y));
    context.rotate(-now.heading);
    const half = Math.max(data.width * scale / 2, 7);
    if (data.body_radius) {
      context.beginPath();
      context.arc(0, 0, data.body_radius * scale, 0, 2 * Math.PI);
      context.strokeStyle = "#222222";
      context.lineWidth = 1;
      context.stroke();
    }
    if (data.trailer) tow(now.trailer, data.trailer[0] * scale, data.trailer[1] * scale, half);
    context.beginPath();
    context.moveTo(1.3 * half, 0);
    context.lineTo(-0.6 * half, half);
    context.lineTo(-0.2 * half, 0);
    context.lineTo(-0.6 * half, -half);
    context.closePath();
    context.fillStyle = "#e07b00";
    context.strokeStyle = "#222222";
    context.lineWidth = 1.5;
    context.fill();
    context.stroke();
    context.restore();
    slider.value = String(1000 * time / drive.duration);
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
      time = drive.duration;
      stop();
    }
    draw();
    if (before !== null) requestAnimationFrame(tick);
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
    time = 0;
    draw();
  });
  slider.addEventListener("input", function () {
    time = drive.duration * Number(slider.value) / 1000;
    draw();
  });
  window.addEventListener("resize", fit);
  fit();
  // A link to #play starts at once.
  if (window.location.hash === "#play") button.click();
});
