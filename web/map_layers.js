// SPDX-License-Identifier: BSD-3-Clause
/** What is drawn above the map: ages, cloud, path, scans, goal, robot, and a measure. Each is a function of its own. */

const OUTLINE = '#000', ROBOT = '#3fb950', LOST = '#8b949e', GOAL = '#e3b341', PATH = '#3fb950';
const USUAL_FOOTPRINT = [[0.35, 0.25], [-0.35, 0.25], [-0.35, -0.25], [0.35, -0.25]];
const LEAST_ROBOT = 18;         // length of the robot's mark [pixel]
const SIZES = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200];

/** The colours of ages 0..100 s: clear, then blue, then red; 255: unknown, clear. (256, 4) bytes, RGBA. */
export const AGE_COLOURS = new Uint8ClampedArray(1024);
for (let age = 0; age <= 100; age++) {
  const ratio = age / 100;
  AGE_COLOURS.set([255 * ratio, 40, 255 * (1 - ratio), 150 * Math.min(1, age / 20)], age * 4);
}

/** Draw a raster whose lower left corner is at a place on the ground. @param {{x, y, yaw, resolution}} place */
export function drawRaster(context, camera, raster, place) {
  const [left, top] = camera.toScreen(place.x, place.y);
  const scale = place.resolution * camera.scale;
  context.save();
  context.translate(left, top);
  context.rotate(-(place.yaw || 0));
  context.scale(scale, scale);
  context.drawImage(raster, 0, -raster.height);
  context.restore();
}

/** Draw a line through places on the ground. */
export function drawPath(context, camera, points) {
  if (points.length < 2) return;
  context.beginPath();
  for (const [x, y] of points) context.lineTo(...camera.toScreen(x, y));
  context.strokeStyle = PATH;
  context.lineWidth = 2.5 * camera.mark;
  context.lineJoin = 'round';
  context.stroke();
}

/** Draw points. @param {Float32Array} points pairs of x, y [m] */
export function drawPoints(context, camera, points, colour, size) {
  const side = Math.max(3 * camera.mark, size * camera.scale);
  context.fillStyle = colour;
  for (let index = 0; index + 1 < points.length; index += 2) {
    const [left, top] = camera.toScreen(points[index], points[index + 1]);
    context.fillRect(left - side / 2, top - side / 2, side, side);
  }
}

/** Draw the robot: its outline and where it heads. @param {boolean} known whether its place is that of now */
export function drawRobot(context, camera, pose, footprint, known) {
  const [left, top] = camera.toScreen(pose.x, pose.y);
  const outline = footprint && footprint.length > 2 ? footprint : USUAL_FOOTPRINT;
  const longest = Math.max(...outline.map(([x, y]) => 2 * Math.hypot(x, y)));
  const scale = Math.max(camera.scale, LEAST_ROBOT * camera.mark / longest);      // a mark that is too small cannot be seen
  context.save();
  context.translate(left, top);
  context.rotate(-pose.yaw);
  context.beginPath();
  for (const [x, y] of outline) context.lineTo(x * scale, -y * scale);
  context.closePath();
  context.fillStyle = known ? ROBOT : LOST;
  context.globalAlpha = 0.35;
  context.fill();
  context.globalAlpha = 1;
  strokeTwice(context, known ? ROBOT : LOST, 2.5 * camera.mark);
  context.beginPath();
  const front = longest * scale * 0.9;
  context.moveTo(0, 0);
  context.lineTo(front, 0);
  context.moveTo(front - 8 * camera.mark, -7 * camera.mark);
  context.lineTo(front, 0);
  context.lineTo(front - 8 * camera.mark, 7 * camera.mark);
  strokeTwice(context, known ? ROBOT : LOST, 3 * camera.mark);
  context.restore();
}

/** Draw a goal: a flag's foot, and where the robot shall head. @param {boolean} sent whether it left this page */
export function drawGoal(context, camera, goal, sent) {
  context.save();
  context.translate(...camera.toScreen(goal.x, goal.y));
  context.rotate(-goal.yaw);
  context.scale(camera.mark, camera.mark);
  context.setLineDash(sent ? [] : [6, 4]);
  context.beginPath();
  context.arc(0, 0, 11, 0, 2 * Math.PI);
  context.moveTo(0, 0);
  context.lineTo(34, 0);
  context.moveTo(25, -8);
  context.lineTo(34, 0);
  context.lineTo(25, 8);
  strokeTwice(context, GOAL, 3.5);
  context.restore();
}

/** Draw a measure of a round length in the lower left corner. */
export function drawMeasure(context, camera) {
  const {mark} = camera;
  const length = SIZES.find((size) => size * camera.scale > 60 * mark) || SIZES[SIZES.length - 1];
  const [left, top, width] = [14, camera.height / mark - 14, length * camera.scale / mark];
  context.save();
  context.scale(mark, mark);
  context.beginPath();
  context.moveTo(left, top - 6);
  context.lineTo(left, top);
  context.lineTo(left + width, top);
  context.lineTo(left + width, top - 6);
  strokeTwice(context, '#fff', 2);
  context.font = '600 15px system-ui, sans-serif';
  context.lineWidth = 4;
  context.strokeStyle = OUTLINE;
  context.strokeText(`${length} m`, left + 6, top - 8);
  context.fillStyle = '#fff';
  context.fillText(`${length} m`, left + 6, top - 8);
  context.restore();
}

/** Draw a line on any ground: with a dark edge. */
function strokeTwice(context, colour, width) {
  context.lineWidth = width + 2.5;
  context.strokeStyle = OUTLINE;
  context.stroke();
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke();
}
